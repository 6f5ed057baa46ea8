"""A config's text while it is edited."""

from pathlib import Path

import pytest
from boxes_config import CONFIG, write_boxes

from focusjax.config import ConfigError
from focusjax.studio import Document, EditError
from focusjax.studio._document import add_row, change_row, delete_row, set_value

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.toml"))
NEW = {"name": "new", "pixel": [10.0, 20.0], "sharp": True}


@pytest.fixture
def document(tmp_path):
    return Document(write_boxes(tmp_path))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_wish_that_comes_and_goes_leaves_every_config_as_it_was(path):
    document = Document(path)
    before = len(document.config.focus)
    document.edit(add_row("focus", row=NEW))
    assert len(document.config.focus) == before + 1
    document.edit(delete_row("focus", number=before))
    assert document.text == path.read_text()
    assert not document.unsaved


def test_comments_stay_and_only_what_changes_changes(document):
    document.replace(document.text.replace("[lens]", "# the old lens\n[lens] # 50 mm"))
    document.edit(set_value("lens", "f_number", value=4.0))
    assert "# the old lens\n[lens] # 50 mm\nf_number = 4.0\n" in document.text
    changed = document.text.replace("f_number = 4.0", "f_number = 2.0")
    assert changed == CONFIG.replace("[lens]", "# the old lens\n[lens] # 50 mm")


def test_the_last_wish_may_go_and_others_come(document):
    for _ in range(2):
        document.edit(delete_row("focus", number=0))
    assert document.config.focus == ()
    document.edit(add_row("focus", row=NEW))
    document.edit(add_row("focus", row=NEW | {"name": "second"}))
    assert [wish.name for wish in document.config.focus] == ["new", "second"]


def test_wishes_in_an_inline_array_are_edited_too(document):
    head, tail = document.text.split("[[focus]]")[0], document.text.split("[solve]")[1]
    document.replace(f"focus = [{{pixel = [1, 2], sharp = true}}]\n{head}[solve]{tail}")
    document.edit(add_row("focus", row=NEW))
    document.edit(change_row("focus", number=0, row={"blur_px": 3.0}, without=["sharp"]))
    assert [(wish.pixel, wish.blur_px) for wish in document.config.focus] == [
        ((1, 2), 3.0),
        ((10.0, 20.0), None),
    ]


def test_undo_and_redo_walk_through_the_edits(document):
    texts = [document.text]
    for number in (4.0, 5.6):
        document.edit(set_value("lens", "f_number", value=number))
        texts.append(document.text)
    assert not document.can_redo
    document.undo()
    document.undo()
    document.undo()  # nothing is left
    assert (document.text, document.can_undo) == (texts[0], False)
    document.redo()
    assert document.text == texts[1]
    document.edit(set_value("lens", "f_number", value=8.0))
    assert not document.can_redo
    assert document.config.lens.f_number == 8.0


def test_edits_of_one_drag_are_undone_together(document):
    before = document.text
    for x in (1.0, 2.0, 3.0):
        document.edit(change_row("focus", number=0, row={"point": [x, 0.0, -1.75]}), "drag")
    document.end_label()
    document.edit(change_row("focus", number=0, row={"point": [9.0, 0.0, -1.75]}), "drag")
    document.undo()
    assert document.config.focus[0].point == (3.0, 0.0, -1.75)
    document.undo()
    assert document.text == before


def test_an_edit_that_leaves_no_config_changes_nothing(document):
    before = document.text
    with pytest.raises(EditError, match=r"lens\.f_number is -1\.0.*expected a number above 0"):
        document.edit(set_value("lens", "f_number", value=-1.0))
    assert (document.text, document.can_undo, document.problem) == (before, False, "")


def test_a_config_with_errors_opens_with_its_problem(tmp_path):
    path = write_boxes(tmp_path)
    path.write_text(CONFIG.replace("f_number = 2.0", "f_numbr = 2.0"))
    document = Document(path)
    assert document.config is None
    assert "did you mean f_number" in document.problem
    with pytest.raises(EditError, match="f_numbr"):
        document.save()
    document.replace(CONFIG)
    document.save()
    assert path.read_text() == CONFIG


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"a\.toml: this is not text in UTF-8"):
        Document(tmp_path / "a.toml")
    with pytest.raises(ConfigError, match=r"b\.toml: there is no such config file"):
        Document(tmp_path / "b.toml")


def test_saving_does_not_write_over_what_others_wrote(document):
    document.edit(set_value("lens", "f_number", value=4.0))
    document.path.write_text("# mine\n" + CONFIG)
    with pytest.raises(EditError, match="was changed by something else"):
        document.save()
    assert document.path.read_text() == "# mine\n" + CONFIG
    document.save(even_if_changed=True)
    assert document.path.read_text() == document.text
    assert not document.unsaved

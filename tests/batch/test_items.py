"""Which items a grid and a table make, what they are called, and what is wrong with them."""

import re

import pytest

from focusjax.batch import BatchError, is_batch_file, items_from_file, make_items, parse_grid, read_table
from focusjax.batch._grid import toml_text
from focusjax.batch._items import safe_names
from focusjax.config import ConfigError


def names(items):
    return [item.name for item in items]


def table(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    return path


def test_a_config_alone_is_one_item(boxes):
    (item,) = make_items([boxes])
    assert (item.name, item.changes) == ("boxes", ())


def test_a_grid_makes_all_combinations(boxes):
    items = make_items([boxes], grid={"lens.f_number": [2, 4.0], "focus.1.blur_px": [3, 5, 7]})
    assert len(items) == 6
    assert names(items)[:2] == [
        "boxes,lens.f_number=2,focus.1.blur_px=3",
        "boxes,lens.f_number=2,focus.1.blur_px=5",
    ]
    assert items[-1].name == "boxes,lens.f_number=4.0,focus.1.blur_px=7"
    assert (items[-1].config.lens.f_number, items[-1].config.focus[1].blur_px) == (4.0, 7)
    assert items[-1].changes == (("lens.f_number", 4.0), ("focus.1.blur_px", 7))


def test_overrides_go_for_all_and_into_no_name(boxes):
    items = make_items([boxes], grid={"lens.f_number": [2, 4]}, overrides=["render.rays=7"])
    assert names(items) == ["boxes,lens.f_number=2", "boxes,lens.f_number=4"]
    assert {item.config.render.rays for item in items} == {7}


def test_a_table_changes_what_its_cells_say(boxes, tmp_path):
    text = '\ufeffname,lens.f_number,focus.0.point,title\nwide open,1.4,,\n,,"[0, 0, -2]",two words\n\n,8,,\n'
    items = make_items([boxes], table=table(tmp_path, text))
    assert names(items) == [
        "wide_open",
        "boxes,focus.0.point=0_0_-2,title=two_words",
        "boxes,lens.f_number=8",
    ]
    assert items[0].changes == (("lens.f_number", 1.4),)
    assert items[1].config.lens.f_number == 2.0
    assert items[1].config.focus[0].point == (0, 0, -2)
    assert items[1].config.title == "two words"


def test_a_table_and_a_grid_and_two_configs(boxes, tmp_path):
    other = boxes.with_name("other.toml")
    other.write_text(boxes.read_text())
    rows = table(tmp_path, "name,lens.f_number\nwide,1.4\nsmall,11\n")
    items = make_items([boxes, other], table=rows, grid={"render.rays": [8, 9]})
    assert names(items)[:3] == [
        "boxes,wide,render.rays=8",
        "boxes,wide,render.rays=9",
        "boxes,small,render.rays=8",
    ]
    assert len(set(names(items))) == 8


def test_a_table_may_give_what_the_config_lacks(boxes, tmp_path):
    boxes.write_text(boxes.read_text().replace("f_number = 2.0", ""))
    (item,) = make_items([boxes], table=table(tmp_path, "lens.f_number\n2.8\n"))
    assert item.config.lens.f_number == 2.8
    with pytest.raises(ConfigError, match="lens needs exactly one of f_number and aperture_radius_mm"):
        make_items([boxes])


def test_names_do_not_depend_on_other_items(boxes):
    few = make_items([boxes], grid={"lens.f_number": [4]})
    many = make_items([boxes], grid={"lens.f_number": [2, 4, 8]})
    assert few[0].name in names(many)


def test_configs_of_the_same_name_are_distinguished(boxes, tmp_path):
    twin = tmp_path / "boxes.toml"
    twin.write_text(boxes.read_text())
    first, second = names(make_items([boxes, twin]))
    assert first != second
    assert all(re.fullmatch(r"boxes-[0-9a-f]{8}", name) for name in (first, second))
    # The same ones from elsewhere, in another order.
    assert names(make_items([twin, boxes.parent / ".." / "scene" / "boxes.toml"])) == [second, first]


@pytest.mark.parametrize(
    ("wanted", "pattern"),
    [
        ("town,lens.f_number=2", r"town,lens\.f_number=2"),
        ("../../etc", "etc"),
        ("a b/c\\d:e*", "a_b_c_d_e"),
        ("früh", "früh"),
        ("...", "[0-9a-f]{8}"),
        ("summary.json", r"summary\.json-[0-9a-f]{8}"),
        ("x" * 500, "x{111}-[0-9a-f]{8}"),
        ("é" * 200, "é{55}-[0-9a-f]{8}"),
    ],
)
def test_names_are_good_for_folders(wanted, pattern):
    (name,) = safe_names([wanted], ["identity"])
    assert re.fullmatch(pattern, name)
    assert len(name.encode()) <= 120


def test_names_that_differ_in_capitals_alone_are_distinguished():
    first, second = safe_names(["Lamp", "lamp"], ["1", "2"])
    assert first.casefold() != second.casefold()


@pytest.mark.parametrize(
    "value", [2, 2.5, float("inf"), True, 'say "hi" \\ ü', [1, [2, "x"]], {"a b": {"c": 1}}]
)
def test_values_survive_being_written(value):
    assert parse_grid([f"a.b=[{toml_text(value)}]"]) == {"a.b": [value]}


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["lens.f_number"], "--grid lens.f_number: expected KEY=[VALUE, ...], for example lens.f_number=[2"),
        (["lens.f_number=2"], "--grid lens.f_number=2: expected KEY=[VALUE, ...]"),
        (["=[2]"], "--grid =[2]: expected KEY=[VALUE, ...]"),
        (["render.quality=[draft]"], 'text in the brackets wants quotes, as in ["draft", "good"]'),
        (["a.b=[1]", "a.b=[2]"], "--grid a.b=[2]: a.b has a --grid already; put all its values into one"),
    ],
)
def test_grids_that_cannot_be_read(texts, message):
    with pytest.raises(BatchError, match=re.escape(message)):
        parse_grid(texts)


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({"lens.f_number": []}, "the grid's lens.f_number has no values; give some"),
        ({"lens.f_number": [2, 4, 2]}, "the grid's lens.f_number has 2 2 times; give it once"),
        (
            {"lens.f_numbr": [2]},
            "--grid lens.f_numbr=2: {path}: unknown key lens.f_numbr; did you mean f_number?",
        ),
        (
            {"render.rays": [4, 0]},
            "--grid render.rays=0: {path}: render.rays is 0; expected a number of at least 1",
        ),
        (
            {"render.rays": [4], "focus.7.weight": [1]},
            "--grid focus.7.weight=1: focus has 2 entries; expected a number from 0 to 1 after it, not 7",
        ),
    ],
)
def test_grids_that_are_wrong(boxes, grid, message):
    with pytest.raises(BatchError, match="^" + re.escape(message.replace("{path}", str(boxes)))):
        make_items([boxes], grid=grid)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "row 1 has no keys; expected a header such as name,lens.f_number"),
        ("lens.f_number\n\n", "there are no rows below the header; add one for each item"),
        ("a,,b\n1,2,3\n", "row 1, column 2 is empty; give a key such as lens.f_number"),
        ("a,b,a\n1,2,3\n", "row 1 has 2 columns a; keep one of them"),
        ("title\na\n[1, 2]\n", "row 3 has 2 cells for 1 columns; put quotes around values that hold commas"),
        (
            "name,title\na,1\nb,2\na,3\n",
            "row 4, column name: 'a' is the name of row 2 too; give another",
        ),
        ('title\n"open\n', "this is no CSV file in UTF-8 (unexpected end of data); save it as one"),
        (
            "title,lens.fnumber\nx,\ny,2\n",
            "row 3, column lens.fnumber: {path}: unknown key lens.fnumber; did you mean f_number?",
        ),
        (
            "lens.f_number,render.rays\n2,4\n-2,8\n",
            "row 3, column lens.f_number: {path}: lens.f_number is -2; expected a number above 0; give the",
        ),
        (
            "lens.f_number,focus.9.weight\n2,4\n",
            "row 2, column focus.9.weight: focus has 2 entries; expected a number from 0 to 1 after it",
        ),
        ("lens.f_number\n2\n2\n", None),
    ],
)
def test_tables_that_are_wrong(boxes, tmp_path, text, message):
    path = table(tmp_path, text)
    if message is None:
        expected = "two items are the same, boxes,lens.f_number=2-"
        where = f"{path}: row 2 and {path}: row 3; leave one of them out"
        with pytest.raises(BatchError, match=re.escape(where)) as caught:
            make_items([boxes], table=path)
        assert str(caught.value).startswith(expected)
        return
    with pytest.raises(BatchError, match="^" + re.escape(f"{path}: {message}".replace("{path}", str(boxes)))):
        make_items([boxes], table=path)


def test_a_table_that_is_not_there(tmp_path):
    with pytest.raises(BatchError, match=r"gone\.csv: there is no such table; check the path"):
        read_table(tmp_path / "gone.csv")
    with pytest.raises(BatchError, match="the table cannot be read"):
        read_table(tmp_path)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BatchError, match="no CSV file in UTF-8"):
        read_table(tmp_path / "binary.csv")


def test_a_key_of_both_table_and_grid_is_refused(boxes, tmp_path):
    rows = table(tmp_path, "lens.f_number\n2\n")
    with pytest.raises(BatchError, match=r"column lens\.f_number is also in the grid; give the key in one"):
        make_items([boxes], table=rows, grid={"lens.f_number": [3]})


def test_what_is_wrong_for_all_items_is_blamed_on_no_row(boxes, tmp_path):
    rows = table(tmp_path, "lens.f_number\n2\n")
    with pytest.raises(ConfigError, match=r"^--set render: expected key=value"):
        make_items([boxes], table=rows, overrides=["render"])
    with pytest.raises(ConfigError, match=r"gone\.toml: there is no such config file"):
        make_items([boxes, boxes.with_name("gone.toml")], table=rows)
    with pytest.raises(BatchError, match="there are no configs"):
        make_items([])


DESCRIPTION = """
[batch]
configs = ["scene/boxes.toml"]
table = "table.csv"
[batch.grid]
focus.1.blur_px = [3, 5]
"render.rays" = [9]
[batch.set]
camera.resolution = [32, 24]
"""


def test_a_batch_in_a_file(boxes, tmp_path, monkeypatch):
    table(tmp_path, "name,lens.f_number\nwide,1.4\n")
    path = tmp_path / "batch.toml"
    path.write_text(DESCRIPTION)
    assert is_batch_file(path)
    assert not is_batch_file(boxes)
    # Paths are relative to the file, wherever it is read from.
    monkeypatch.chdir("/")
    items = items_from_file(path, ("camera.resolution=[16, 12]",))
    assert names(items) == [
        "wide,focus.1.blur_px=3,render.rays=9",
        "wide,focus.1.blur_px=5,render.rays=9",
    ]
    assert items[0].config.camera.resolution == (16, 12)
    assert items[0].config.lens.f_number == 1.4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[batch]\n", "batch.configs is missing; give configs' paths, relative to this file"),
        ("[batch]\nconfigs = []\n", "batch.configs is []; expected at least 1 entries; give configs' paths"),
        ("[batch]\nconfig = ['a']\n", "unknown key batch.config; did you mean configs?"),
        (
            "[batch]\nconfigs = ['a']\n[batch.grid]\na.b = 3\n",
            "batch.grid.a.b is 3; expected a list of values",
        ),
        ("title = 'x'\n[batch]\nconfigs = ['a']\n", "unknown key title; known keys here are batch"),
    ],
)
def test_batch_files_that_are_wrong(tmp_path, text, message):
    path = tmp_path / "batch.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="^" + re.escape(f"{path}: {message}")):
        items_from_file(path)

"""What one item leaves for the next."""

import dataclasses
from types import SimpleNamespace

import trimesh

from focusjax.batch import _work, make_items
from focusjax.batch._fingerprint import Fingerprints
from focusjax.many import carry_out


def test_a_worker_hands_on_its_scene_and_the_extent_of_its_layers(boxes, tmp_path, monkeypatch):
    calls = []

    def run(config, *, rendering, scene, like, spare):
        assert spare
        calls.append((rendering, scene, like))
        return SimpleNamespace(picture=SimpleNamespace(extent=len(calls)))

    monkeypatch.setattr(_work.job, "run", run)
    monkeypatch.setattr(_work, "save_outcome", lambda folder, outcome: None)
    monkeypatch.setattr(_work, "_save_thumbnail", lambda folder: None)
    scales = ["scene.objects.0.scale=1", "scene.objects.0.scale=1", "scene.objects.0.scale=2"]
    monkeypatch.setattr(_work.DoItem, "_kept", {})
    out, tasks = tmp_path / "out", []
    out.mkdir()
    for number, scale in enumerate(scales):
        (item,) = make_items([boxes], overrides=[scale])
        item = dataclasses.replace(item, name=str(number))
        tasks.append(_work.task_of(item, Fingerprints().of(item.config, solve_only=False)))
    ended = list(carry_out(_work.DoItem(out, solve_only=False), tasks, out))
    assert [each.error for each in ended] == [""] * 3
    assert [rendering for rendering, _, _ in calls] == [True] * 3
    assert [like for _, _, like in calls] == [None, 1, 2]
    first, second, larger = (scene for _, scene, _ in calls)
    assert second is first
    assert larger is not first
    # The same table, but the mesh is another.
    trimesh.creation.box((0.5, 0.5, 0.4)).export(boxes.with_name("box.ply"))
    again = _work.task_of(
        dataclasses.replace(item, name="3"), Fingerprints().of(item.config, solve_only=False)
    )
    list(carry_out(_work.DoItem(out, solve_only=False), [again], out))
    assert calls[3][1] is not larger


def test_what_is_no_fault_of_the_user_is_said_to_be_ours(boxes, tmp_path, monkeypatch):
    def run(*arguments, **options):
        raise KeyError("lens")

    monkeypatch.setattr(_work.job, "run", run)
    (item,) = make_items([boxes])
    out = tmp_path / "out"
    out.mkdir()
    task = _work.task_of(item, Fingerprints().of(item.config, solve_only=True))
    (ended,) = carry_out(_work.DoItem(out, solve_only=True), [task], out)
    assert ended.error == "internal error, please report it: KeyError('lens')"
    assert list(out.iterdir()) == []

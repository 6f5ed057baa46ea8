"""JSON that any program can read, whatever its numbers."""

import json

import numpy as np

from focusjax.io import for_json, json_text, load_json


def test_numbers_that_are_not_finite_become_text_and_the_rest_stays():
    facts = {
        "far": float("inf"),
        "near": (1.5, -np.inf, [np.float64("nan"), {"deep": float("inf")}]),
        "plain": [1, 2.5, True, None, "inf"],
    }
    expected = {
        "far": "inf",
        "near": [1.5, "-inf", ["nan", {"deep": "inf"}]],
        "plain": [1, 2.5, True, None, "inf"],
    }
    assert for_json(facts) == expected
    assert json.loads(json_text(facts)) == expected


def test_letters_stay_as_they_are():
    assert "é" in json_text({"é": 1})


def test_what_cannot_be_read_is_none(tmp_path):
    (tmp_path / "half.json").write_text("{")
    (tmp_path / "good.json").write_text("[1]")
    (tmp_path / "bytes.json").write_bytes(b"\xff")
    names = ("half.json", "gone.json", "bytes.json", "good.json")
    assert [load_json(tmp_path / name) for name in names] == [None, None, None, [1]]

"""JSON that any program can read."""

import json
import math

from focusjax.io import json_text, load_json


def test_numbers_that_json_has_no_word_for_are_text():
    value = {"far": math.inf, "list": (1.5, -math.inf), "é": math.nan, "whole": 3}
    text = json_text(value)
    assert json.loads(text) == {"far": "inf", "list": [1.5, "-inf"], "é": "nan", "whole": 3}
    assert "é" in text


def test_what_cannot_be_read_is_none(tmp_path):
    (tmp_path / "half.json").write_text("{")
    (tmp_path / "good.json").write_text("[1]")
    (tmp_path / "bytes.json").write_bytes(b"\xff")
    names = ("half.json", "gone.json", "bytes.json", "good.json")
    assert [load_json(tmp_path / name) for name in names] == [None, None, None, [1]]

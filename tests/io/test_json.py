"""What a report holds can be written as JSON, whatever its numbers."""

import json

import numpy as np

from focusjax.io import for_json


def test_numbers_that_are_not_finite_become_text_and_the_rest_stays():
    facts = {
        "far": float("inf"),
        "near": (1.5, -np.inf, [np.float64("nan"), {"deep": float("inf")}]),
        "plain": [1, 2.5, True, None, "inf"],
    }
    text = json.dumps(for_json(facts), allow_nan=False)
    assert json.loads(text) == {
        "far": "inf",
        "near": [1.5, "-inf", ["nan", {"deep": "inf"}]],
        "plain": [1, 2.5, True, None, "inf"],
    }

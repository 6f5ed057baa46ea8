"""Wishes refuse values that mean nothing, in words."""

import pytest

from focusjax.focus import AtPixel, Blur, FocusPoint, OnObject, Sharp
from focusjax.focus._points import Attachment, check_kind
from focusjax.focus._wishes import Wish


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Blur(-3.0), "wished blur is -3.0 px; a diameter is not negative, unless the wish is signed"),
        (lambda: Blur(float("nan")), "wished blur is nan px; expected a diameter of at most 1e\\+06"),
        (
            lambda: OnObject("spot", samples=0),
            "the number of samples of object 'spot' is 0; expected a whole",
        ),
        (
            lambda: FocusPoint(AtPixel(1, 1), Sharp(), weight=-1, name="face"),
            "focus point 'face' has weight -1.0; expected zero or a positive number of at most 1e\\+12",
        ),
        (
            lambda: FocusPoint(AtPixel(1, 1), Sharp(), weight=float("inf")),
            "a focus point has weight inf",
        ),
        (lambda: FocusPoint(AtPixel(1, 1), Sharp(), weight=1e38), "has weight 1e\\+38; expected zero or a"),
        (lambda: FocusPoint(AtPixel(1, 1), Sharp(), tolerance=1e39), "has tolerance 1e\\+39; expected zero"),
        (lambda: Blur(1e20), "wished blur is 1e\\+20 px; expected a diameter of at most 1e\\+06"),
        (
            lambda: FocusPoint(AtPixel(1, 1), Sharp(), tolerance=-0.5),
            "a focus point has tolerance -0.5; expected zero or a positive number of at most 1e\\+06",
        ),
    ],
)
def test_a_value_that_means_nothing_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_signed_blur_may_be_negative():
    assert Blur(-3, signed=True).diameter == -3


@pytest.mark.parametrize(
    ("value", "kinds", "message"),
    [
        (Sharp, Wish, "it has wish <class .*Sharp'>; expected one of Sharp, Blur"),
        (20, Wish, "it has wish 20; expected one of Sharp, Blur"),
        ((0, 0, -2), Attachment, r"it has wish \(0, 0, -2\); expected one of AtPixel, AtPoint"),
    ],
)
def test_what_is_no_wish_or_place_is_refused(value, kinds, message):
    """Also where nobody checks types, as these tests do before a focus point could."""
    with pytest.raises(ValueError, match=message):
        check_kind("it has wish", value, kinds)

"""Who can make a converged picture: methods without bias, whose error only falls with samples."""

import importlib.util
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from focusjax.baselines import counted_mitsuba_picture, lens_picture, unlit_scene
from focusjax.bench._case import Case
from focusjax.bench._methods import ChoiceError

Maker = Callable[[Case, int, int], tuple[Float[np.ndarray, "h w 3"], int]]
"""From a case, samples per pixel and a seed to the picture, and how many samples were not finite.

These are left out; a pixel without any other is not a number.
"""


def _by_mitsuba(case: Case, samples: int, seed: int) -> tuple[Float[np.ndarray, "h w 3"], int]:
    return counted_mitsuba_picture(
        unlit_scene(case.scene), case.camera, case.lens, samples=samples, seed=seed
    )


def _by_casting(case: Case, samples: int, seed: int) -> tuple[Float[np.ndarray, "h w 3"], int]:
    picture = lens_picture(case.scene, case.camera, case.lens, rays=samples, seed=seed)
    return picture, int(np.count_nonzero(~np.isfinite(picture).all(axis=-1)))


_MAKERS: dict[str, tuple[str, Maker]] = {
    "mitsuba": ("mitsuba", _by_mitsuba),
    "raycast": ("embreex", _by_casting),
}


def maker_named(name: str) -> Maker:
    """The maker `name`.

    Raises:
        ChoiceError: there is none, or it is not installed.
    """
    if name not in _MAKERS:
        raise ChoiceError(f"no reference can be made by {name!r}; expected {' or '.join(_MAKERS)}")
    module, maker = _MAKERS[name]
    if importlib.util.find_spec(module) is None:
        raise ChoiceError(
            f"a reference by {name} needs {module}, which is not installed; run"
            " `pip install 'focusjax[bench]'`"
        )
    return maker


def best_maker() -> str:
    """Mitsuba, which shares nothing with focusjax, where it is installed, and our ray cast otherwise.

    Raises:
        ChoiceError: neither is installed.
    """
    for name, (module, _) in _MAKERS.items():
        if importlib.util.find_spec(module) is not None:
            return name
    raise ChoiceError(
        "a converged picture needs Mitsuba or Embree, and neither is installed; run"
        " `pip install 'focusjax[bench]'`"
    )

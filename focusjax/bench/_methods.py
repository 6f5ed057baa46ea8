"""The methods that are compared; a new one, or a new setting, is an entry in the list."""

import dataclasses
import functools
import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

import jax

from focusjax.baselines import (
    SAMPLER,
    RayScene,
    accumulate,
    denoised,
    lens_picture,
    load_unlit,
    mitsuba_picture,
    multilayer,
    pinhole_view,
    scatter,
    unlit_scene,
)
from focusjax.bench._case import Case
from focusjax.layers import peel
from focusjax.post import PinholeView, closed_lens, gather, post_process, view_in_layers
from focusjax.trace import render

Setting = int | float | str
"""The setting of a method: a number of rays, or a name for a quality."""


class ChoiceError(ValueError):
    """What is to be measured is asked for in a way that means nothing."""


@dataclasses.dataclass(frozen=True)
class Method:
    """One way to the picture.

    Attributes:
        name: how it is asked for.
        title: how reports call it.
        knob: what its setting is called.
        settings: those measured when nothing else is asked for, from quick to slow.
        prepare: set-up that all settings share; its time is measured apart.
        render: the picture [h, w, 3] from the case, what `prepare` returned and a setting.
        needs: modules that have to be installed.
        default: measured when no methods are named, if what it needs is installed.
    """

    name: str
    title: str
    knob: str
    settings: tuple[Setting, ...]
    prepare: Callable[[Case], Any]
    render: Callable[[Case, Any, Any], Any]
    needs: tuple[str, ...] = ()
    default: bool = True

    def missing(self) -> tuple[str, ...]:
        """The modules it needs that are not installed."""
        return tuple(name for name in self.needs if importlib.util.find_spec(name) is None)


def _peeled(supersampling: int) -> Callable[[Case], Any]:
    def prepare(case: Case) -> Any:
        return jax.block_until_ready(
            peel(case.scene, case.camera, case.lens, supersampling=supersampling, max_layers=case.max_layers)
        )

    return prepare


def _traced(case: Case, layers: Any, rays: int) -> Any:
    return render(layers, case.lens, rays=rays)


def _own_view(case: Case) -> Any:
    """What a pinhole sees, as focusjax has it."""
    view = view_in_layers(peel(case.scene, case.camera, closed_lens(), supersampling=2), case.scene)
    jax.block_until_ready(view.image)
    return view


def _post_processed(case: Case, view: PinholeView, taps: int) -> Any:
    return post_process(view, case.camera, case.lens, taps=taps)


def _cast(name: str, title: str, knob: str, settings: tuple[int, ...], method: Callable[..., Any]) -> Method:
    """Rays cast at the triangles."""

    def picture(case: Case, ready: Any, setting: int) -> Any:
        return method(ready, case.camera, case.lens, **{knob: setting})

    return Method(name, title, knob, settings, lambda case: RayScene(case.scene), picture, needs=("embreex",))


def _filter(
    name: str,
    title: str,
    knob: str,
    settings: tuple[Setting, ...],
    method: Callable[..., Any],
    keyword: str,
) -> Method:
    """A filter of one sharp view, whose argument `keyword` is the setting."""

    def picture(case: Case, view: Any, setting: Setting) -> Any:
        return method(*view, case.camera, case.lens, **{keyword: setting})

    def sharp(case: Case) -> Any:
        return pinhole_view(case.scene, case.camera)

    return Method(name, title, knob, settings, sharp, picture, needs=("embreex",))


def _mitsuba(
    name: str,
    title: str,
    settings: tuple[int, ...],
    *,
    variant: str = "llvm_ad_rgb",
    sampler: str = SAMPLER,
    default: bool = False,
    denoise: bool = False,
) -> Method:
    def prepare(case: Case) -> Any:
        scene = unlit_scene(case.scene)
        load_unlit(scene, variant)
        return scene

    def picture(case: Case, scene: Any, samples: int) -> Any:
        noisy = mitsuba_picture(
            scene, case.camera, case.lens, samples=samples, variant=variant, sampler=sampler
        )
        return denoised(noisy) if denoise else noisy

    needs = ("mitsuba", "pyoidn") if denoise else ("mitsuba",)
    return Method(name, title, "samples", settings, prepare, picture, needs=needs, default=default)


METHODS: tuple[Method, ...] = (
    Method("tracer", "focusjax, 2 x 2 samples a pixel", "rays", (4, 8, 16, 32, 64, 128), _peeled(2), _traced),
    Method("tracer-1", "focusjax, 1 sample a pixel", "rays", (4, 8, 16, 32, 64, 128), _peeled(1), _traced),
    _mitsuba("mitsuba", "Mitsuba, LLVM", (4, 16, 64, 256), default=True),
    _mitsuba("mitsuba+oidn", "Mitsuba, LLVM, denoised", (4, 8, 16, 64), default=True, denoise=True),
    _mitsuba("mitsuba-scalar", "Mitsuba, scalar", (4, 16, 64), variant="scalar_rgb"),
    _mitsuba(
        "mitsuba-independent",
        "Mitsuba, LLVM, by its default sampler",
        (4, 16, 64, 256),
        sampler="independent",
    ),
    _cast("raycast", "ray cast, Embree", "rays", (4, 16, 64), lens_picture),
    _cast("accumulation", "accumulation buffer", "views", (4, 16, 64), accumulate),
    _filter("gather", "gather, one view", "taps", (16, 64, 256), gather, "taps"),
    _filter("scatter", "scatter, one view", "px step", (1.0, 0.25), scatter, "radius_step"),
    _filter(
        "scatter-normalised",
        "scatter, normalised",
        "px step",
        (1.0, 0.25),
        functools.partial(scatter, normalised=True),
        "radius_step",
    ),
    _filter("multilayer", "multilayer, one view", "layers", (4, 8, 16, 32), multilayer, "layers"),
    Method("post", "post-processing, one view", "taps", (8, 16, 32, 64), _own_view, _post_processed),
)


def method_named(name: str) -> Method:
    """The method called `name`.

    Raises:
        ChoiceError: there is none.
    """
    for method in METHODS:
        if method.name == name:
            return method
    known = ", ".join(method.name for method in METHODS)
    raise ChoiceError(f"there is no method named {name!r}; expected one of {known}")


def chosen_methods(words: Sequence[str]) -> tuple[Method, ...]:
    """Methods as a person asks for them.

    Args:
        words: names such as `tracer`, or names with settings such as `tracer=16,64`; none for all that are
            measured by default and can be here.

    Raises:
        ChoiceError: a name that no method has, one named twice, settings that are no positive numbers, or a
            method that needs what is not installed.
    """
    if not words:
        return tuple(method for method in METHODS if method.default and not method.missing())
    out = []
    for word in words:
        name, equals, listed = word.partition("=")
        method = method_named(name)
        if name in [other.name for other in out]:
            raise ChoiceError(f"the method {name} is asked for twice; name it once, with all its settings")
        if method.missing():
            verb = "is" if len(method.missing()) == 1 else "are"
            raise ChoiceError(
                f"the method {name} needs {' and '.join(method.missing())}, which {verb} not installed; run"
                " `pip install 'focusjax[bench]'`"
            )
        if equals:
            kind = type(method.settings[0])
            method = dataclasses.replace(method, settings=_settings(name, listed, kind))
        out.append(method)
    return tuple(out)


def _settings(name: str, listed: str, kind: type) -> tuple[Setting, ...]:
    try:
        values = [kind(text) for text in listed.split(",")]
        if any(value <= 0 for value in values):
            raise ValueError
    except ValueError:
        example = "16,64" if kind is int else "0.5,1"
        raise ChoiceError(
            f"the settings of {name} are {listed!r}; expected positive numbers such as {name}={example}"
        ) from None
    return tuple(values)

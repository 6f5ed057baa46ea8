"""What Mitsuba 3 answers when asked for the derivative of a picture by focus distance or aperture radius."""

import numpy as np

from focusjax.baselines import mitsuba

PARAMETERS = ("sensor.focus_distance", "sensor.aperture_radius")
INTEGRATORS = ("direct_projective", "prb_projective", "prb")


def mitsuba_answers() -> list[tuple[str, str, str]]:
    """Parameter, integrator and answer for a glowing square that is out of focus.

    The true derivatives are not 0: the square's edges are blurred over several pixels.

    Raises:
        ValueError: Mitsuba cannot be used.
    """
    mi = mitsuba()
    import drjit  # pyright: ignore[reportMissingImports]  # comes with Mitsuba

    scene = mi.load_dict(
        {
            "type": "scene",
            "square": {
                "type": "rectangle",
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
            },
            "sensor": {
                "type": "thinlens",
                "fov": 40,
                "aperture_radius": 0.1,
                "focus_distance": 3.0,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 32, "height": 24, "rfilter": {"type": "box"}},
            },
        }
    )
    values = mi.traverse(scene)
    answers = []
    for parameter in PARAMETERS:
        for integrator in INTEGRATORS:
            try:
                value = mi.Float(values[parameter])
                drjit.enable_grad(value)
                values[parameter] = value
                values.update()
                chosen = mi.load_dict({"type": integrator, "max_depth": 2})
                picture = mi.render(scene, values, integrator=chosen, spp=64)
                drjit.forward(value)
                slope = np.abs(np.array(drjit.grad(picture))).max()
                answer = "0 in every pixel" if slope == 0 else f"up to {slope:.3g} in a pixel"
            except Exception as error:  # Whatever it says is the answer.
                answer = f"{type(error).__name__}: {' '.join(str(error).split())}"
            answers.append((parameter, integrator, answer))
    return answers

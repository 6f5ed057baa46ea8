"""All frames of a shot met by a real lens (Lee10 5.1): smooth over time, in the blur of the glass.

As for a still, the points of every frame are exchanged for ones that a thin lens blurs as the glass blurs
them (`exchanged`), and all frames are solved again for the thin lens, over all sides, bounds, limits, priors
and smoothness. When such rounds settle, Gauss-Newton steps on the blur of the glass itself, coupled by
smoothness, end at its own best settings, with the bounds that are then active.
"""

import dataclasses
import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._device import device_array
from focusjax._programs import jit
from focusjax.focus._frames_asked import FramesAsked, padded_frames, stacked_glass
from focusjax.focus._frames_glass import (
    FramesGlass,
    frames_glass,
    frames_radius,
    with_references,
)
from focusjax.focus._frames_problem import (
    FramesProblem,
    at_bounds,
    frames_problem,
    openness,
    thin_walk,
)
from focusjax.focus._frames_solution import FramesSolution, without_padding
from focusjax.focus._glass_blur import Sensed
from focusjax.focus._glass_rows import GlassRows
from focusjax.focus._glass_search import exchanged, glass_errors
from focusjax.focus._image_points import ImagePoints, filled_up, repeated
from focusjax.focus._joint import Linearised
from focusjax.focus._parameters import Start
from focusjax.focus._priors import PriorRows
from focusjax.focus._solution import PARTLY_OPEN, result_of
from focusjax.lens import AbstractLens, ThinLens, is_tilted

ROUNDS, STEPS, REPORT, DONE = range(4)
"""What is done next: a thin lens's problem, a step through the glass, or a look at every row."""

_ROUNDS = 5
"""Of the thin lens's problem, at most; the first is that of the points themselves, but for a tilted lens."""
_AGAIN = 2
"""Of these from a solution to that of other weights or without smoothness."""
_STEPS = 24
"""Through the glass, at most."""
_SAME_PX = 0.02
"""Change of the picture that ends the rounds when one makes less, and with which steps count as settled."""
_SETTLED_PX = 1e-4
"""Change of the picture that ends the steps."""
_HELD = 0.5
"""How open a parameter is that stays where the thin lens has it."""
_LEAST, _MOST = 1e-8, 1e8
"""Damping of steps through the glass."""


class FramesReached(eqx.Module):
    """Where the search is. Parameters are in pixels.

    Attributes:
        phase: what is done next.
        number: rounds or steps done in this phase.
        steps: looks in all.
        pixels: where rays look next.
        best: the best parameters that a step has looked at.
        here: the problem there.
        damping: of the next step.
        last: change of the last step.
        open: how open each parameter is.
        thin: whether the last round settled.
        found: what rays say of every row, once the search is done.
    """

    phase: Int[Array, ""]
    number: Int[Array, ""]
    steps: Int[Array, ""]
    pixels: Float[Array, "t k"]
    best: Float[Array, "t k"]
    here: Linearised
    damping: Float[Array, ""]
    last: Float[Array, ""]
    open: Float[Array, "k"]
    thin: Bool[Array, ""]
    found: Sensed


def solve_frames_through(asked: FramesAsked, near: FramesSolution | None = None) -> FramesSolution:
    """The solution of a checked problem through its glass.

    Args:
        asked: the problem.
        near: the solution of one that differs in weights or smoothness: two rounds from there are done, and
            no steps. The rows that had weight are looked at.
    """
    count, longer = asked.present.size, padded_frames(dataclasses.replace(asked, names=()))
    size = longer.present.size
    again = near is not None
    none = device_array(np.zeros((count, len(asked.plan.free))), asked.points.disparity.dtype)
    first = repeated(none if near is None else near.pixels, size)
    reported = np.ones(asked.points.weight.shape, dtype=bool) if near is None else near.points.weight > 0.0
    solution = _solve(longer, first, jnp.asarray(again), filled_up(reported, size, False))
    solution = without_padding(solution, count)
    points = dataclasses.replace(solution.points, names=asked.names)
    return dataclasses.replace(solution, points=points, asked=asked, glass=asked.glass)


def frames_seen_through(solution: FramesSolution, glasses: Sequence[AbstractLens]) -> FramesSolution:
    """The solution for an ideal lens with what its settings make of the wishes through glass.

    Args:
        solution: of frames.
        glasses: of every frame, with the settings of its lens.
    """
    glass = stacked_glass(glasses)
    blur, error = _seen_at(solution, glass)
    return dataclasses.replace(solution, blur=blur, error=error, glass=glass)


@jit
def _seen_at(
    solution: FramesSolution, glass: AbstractLens
) -> tuple[Float[Array, "t n"], Float[Array, "t n"]]:
    """Blur and errors through glass that is set already."""
    lens, points = solution.lens, solution.points
    focus = lens.focus_disparity if isinstance(lens, ThinLens) else lens.plane[:, 2]
    aimed = frames_glass(glass, solution.camera, focus)
    settings = jnp.stack([focus, aimed.widest], axis=1)
    every = with_references(points, jnp.ones(points.weight.shape, dtype=bool))
    return jax.vmap(glass_errors)(aimed.look(points, settings, every).blur, points)


@jit
def _solve(
    asked: FramesAsked, near: Float[Array, "t k"], again: Bool[Array, ""], reported: Bool[Array, "t n"]
) -> FramesSolution:
    """The compiled part; `reported` are the rows to look at in the end."""
    assert asked.glass is not None
    widest = frames_radius(asked.glass)
    radius = jnp.minimum(asked.lens.aperture_radius, widest)
    asked = dataclasses.replace(
        asked,
        lens=eqx.tree_at(lambda lens: lens.aperture_radius, asked.lens, radius),
        limits=jax.vmap(lambda limits, *of: limits.no_wider(*of))(asked.limits, asked.camera, widest),
    )
    problem = frames_problem(asked)
    reached = _Search(asked, problem).run(near, again, reported)
    return _reported(asked, problem, reached)


class _Search(eqx.Module):
    """The search of one problem."""

    asked: FramesAsked
    problem: FramesProblem

    def run(
        self, near: Float[Array, "t k"], again: Bool[Array, ""], reported: Bool[Array, "t n"]
    ) -> FramesReached:
        """The best parameters, and what rays say there.

        One loop has the rounds, the steps and the last look, so that rays are compiled once.
        """
        points = self.asked.points
        shapes, fixed = eqx.partition(
            eqx.filter_eval_shape(lambda pixels: self._aim(pixels), near),
            lambda leaf: isinstance(leaf, jax.ShapeDtypeStruct),
        )
        counts = with_references(points, points.weight > 0.0)
        reported = with_references(points, reported)

        def step(carry: tuple[FramesReached, FramesGlass]) -> tuple[FramesReached, FramesGlass]:
            state, aims = carry
            # Steps compare what the same rays say.
            anew = (state.phase == ROUNDS) | ((state.phase == STEPS) & (state.number == 0))
            aims = jax.lax.cond(anew, lambda: eqx.filter(self._aim(state.pixels), eqx.is_array), lambda: aims)
            blind = (state.phase == ROUNDS) & (state.number == 0)
            wanted = jnp.where(state.phase == REPORT, reported, counts & ~blind)
            found = eqx.combine(aims, fixed).look(points, self._settings(state.pixels), wanted)
            # In the order of the phases. Bound methods of a module that holds arrays cannot be hashed.
            turns = (
                lambda state, found: self._round(state, found, again),
                lambda state, found: self._step(state, found),
                lambda state, found: self._report(state, found),
            )
            state = jax.lax.switch(state.phase, turns, state, found)
            return dataclasses.replace(state, steps=state.steps + 1), aims

        def moving(carry: tuple[FramesReached, FramesGlass]) -> Bool[Array, ""]:
            return carry[0].phase != DONE

        blank = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        state, _ = jax.lax.while_loop(moving, step, (self._begun(near, again), blank))
        return state

    def _begun(self, near: Float[Array, "t k"], again: Bool[Array, ""]) -> FramesReached:
        """Before the first round; `again` starts with the second, from `near`."""
        points, joint = self.asked.points, self.problem.joint

        def looked() -> tuple[Linearised, Sensed]:
            found = self._aim(near).look(
                points, self._settings(near), with_references(points, points.weight > 0.0)
            )
            return joint.coupled(near, *self._rows(near, found)), found

        unseen = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), eqx.filter_eval_shape(looked))
        far = jnp.full_like(joint.unit, jnp.inf)
        start = jnp.where(again, near, self.problem.first * joint.scale)
        return FramesReached(
            phase=jnp.array(ROUNDS),
            number=jnp.where(again, 1, 0),
            steps=jnp.array(0),
            pixels=start,
            best=start,
            here=dataclasses.replace(unseen[0], cost=far),
            damping=jnp.full_like(far, _LEAST),
            last=far,
            open=jnp.zeros_like(near[0]),
            thin=jnp.array(False),
            found=unseen[1],
        )

    def _aim(self, pixels: Float[Array, "t k"]) -> FramesGlass:
        glass = self.asked.glass
        assert glass is not None
        return frames_glass(glass, self.asked.camera, self._settings(pixels)[:, 0])

    def _settings(self, pixels: Float[Array, "t k"]) -> Float[Array, "t 2"]:
        """Focus and aperture radius of every frame."""
        problem = self.problem
        return jax.vmap(Start.setting)(problem.start, pixels / problem.joint.scale)

    def _round(self, state: FramesReached, found: Sensed, again: Bool[Array, ""]) -> FramesReached:
        """The thin lens's problem with points that it blurs as the glass does."""
        asked = self.asked
        thin = jax.vmap(exchanged)(asked.points, asked.camera, self._settings(state.pixels), found)
        assert asked.glass is not None
        if not is_tilted(asked.glass):
            thin = jax.tree.map(lambda a, b: jnp.where(state.number == 0, a, b), asked.points, thin)
        asked = dataclasses.replace(asked, points=thin)
        problem = frames_problem(asked)
        walked = thin_walk(problem, asked)
        here = problem.joint.linearised(walked.pixels, walked.side)
        moved = jnp.abs(walked.pixels - state.pixels)
        change = jnp.max(moved, where=problem.joint.present[:, None], initial=0.0)
        most = jnp.where(again, 1 + _AGAIN, _ROUNDS)
        ended = ((state.number > 0) & (change < _SAME_PX)) | (state.number + 1 == most)
        return dataclasses.replace(
            state,
            phase=jnp.where(ended, jnp.where(again, REPORT, STEPS), ROUNDS),
            number=jnp.where(ended, 0, state.number + 1),
            pixels=walked.pixels,
            best=walked.pixels,
            last=change,
            open=openness(problem.joint, here),
            thin=walked.settled,
        )

    def _step(self, state: FramesReached, found: Sensed) -> FramesReached:
        """A Gauss-Newton step from the best parameters so far, or the last of them."""
        joint = self.problem.joint
        new = joint.coupled(state.pixels, *self._rows(state.pixels, found))
        better = new.cost < state.here.cost
        best, here = jax.tree.map(
            functools.partial(jnp.where, better), (state.pixels, new), (state.best, state.here)
        )
        damping = jnp.where(better, state.damping / 32.0, jnp.maximum(state.damping * 16.0, 1e-3))
        damping = jnp.maximum(damping, _LEAST)
        moved = joint.step(here, best, damping, state.open > _HELD)
        last = jnp.max(jnp.abs(moved - best))
        ended = (last < _SETTLED_PX) | (damping > _MOST) | (state.number + 1 == _STEPS)
        return dataclasses.replace(
            state,
            phase=jnp.where(ended, REPORT, STEPS),
            number=state.number + 1,
            pixels=jnp.where(ended, best, moved),
            best=best,
            here=here,
            damping=damping,
            last=last,
        )

    def _report(self, state: FramesReached, found: Sensed) -> FramesReached:
        here = self.problem.joint.coupled(state.pixels, *self._rows(state.pixels, found))
        return dataclasses.replace(state, phase=jnp.array(DONE), best=state.pixels, here=here, found=found)

    def _rows(
        self, pixels: Float[Array, "t k"], found: Sensed
    ) -> tuple[Float[Array, "t m"], Float[Array, "t m k"]]:
        """The frames' own residuals through the glass and their slopes, in the units of `Joint`."""
        joint = self.problem.joint
        columns = jnp.array(joint.frames.columns)

        def one(
            points: ImagePoints, found: Sensed, value: Float[Array, "k"], priors: PriorRows
        ) -> tuple[Array, Array]:
            return GlassRows(points).rows(found, found.blur.signed, columns, value, priors)

        value = pixels / joint.scale
        own, slopes = jax.vmap(one)(self.asked.points, found, value, joint.frames.priors)
        root = jnp.sqrt(joint.unit)
        return own / root, slopes / (root * joint.scale[:, None])


def _reported(asked: FramesAsked, problem: FramesProblem, reached: FramesReached) -> FramesSolution:
    """What was found, in the blur of the glass."""
    joint, points, pixels = problem.joint, asked.points, reached.pixels
    at_lower, at_upper = at_bounds(joint, reached.here, pixels)
    value = jnp.clip(pixels / joint.scale, problem.boxes.lower, problem.boxes.upper)

    def of_frame(start: Start, value: Float[Array, "k"]) -> tuple:
        return start.camera_at(value), start.lens_at(value)

    camera, lens = jax.vmap(of_frame)(problem.start, value)
    blur, error = jax.vmap(glass_errors)(reached.found.blur, points)
    is_open = reached.open > PARTLY_OPEN
    settled = reached.thin & (reached.last < _SAME_PX)
    return FramesSolution(
        lens=lens,
        camera=camera,
        points=points,
        blur=blur,
        error=error,
        pixels=pixels,
        cost=joint.unit * reached.here.cost,
        roughness=0.5 * joint.unit * sum(jnp.sum(each**2) for each in joint.smooth(pixels)),
        result=result_of(settled, is_open, error),
        steps=reached.steps,
        at_lower=at_lower & ~asked.held,
        at_upper=at_upper & ~asked.held,
        open=is_open,
        free=asked.plan.free,
    )

"""The bounded solver against SciPy's, and its derivatives at bounds against those of solving again."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
import pytest
import scipy.optimize

from focusjax.solvers import (
    BandedJacobian,
    BandedQR,
    BoundedImplicitAdjoint,
    BoundedLevenbergMarquardt,
    BoundedStep,
    ConditionAdjoint,
    DampedOperator,
    JaxoptLBFGSB,
    half_squares,
    solve_banded,
)


def curve(y, args):
    """How far a decaying wave is from what is given: 5 unknowns, coupled and not linear."""
    times, given = args
    offset, size, decay, rate, phase = y
    return offset + size * jnp.exp(-decay * times) * jnp.cos(rate * times + phase) - given


def random_curve(seed):
    """Arguments of `curve`, a start, and bounds of which some keep from the best fit."""
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 3.0, 40)
    hidden = np.array([0.3, 2.0, 0.5, 3.0, 0.2]) * rng.uniform(0.8, 1.2, 5)
    given = np.asarray(curve(hidden, (times, 0.0))) + 0.1 * rng.normal(size=40)
    low, high = hidden * rng.uniform(0.6, 1.02, 5), hidden * rng.uniform(1.0, 1.4, 5)
    low, high = np.minimum(low, high - 0.02), np.maximum(low + 0.02, high)
    start = rng.uniform(low, high)
    return (jnp.asarray(times), jnp.asarray(given)), jnp.asarray(start), jnp.asarray(low), jnp.asarray(high)


@eqx.filter_jit
def solved(args, start, low, high, solver=None, **more):
    return optx.least_squares(
        curve,
        BoundedLevenbergMarquardt(1e-12, 1e-12) if solver is None else solver,
        start,
        args=args,
        options={"lower": low, "upper": high},
        adjoint=BoundedImplicitAdjoint(),
        **more,
    )


def test_it_finds_what_scipy_finds():
    slopes = jax.jit(jax.jacfwd(curve))
    residuals = jax.jit(curve)
    at_bounds = 0
    for seed in range(20):
        args, start, low, high = random_curve(seed)
        found = solved(args, start, low, high)
        other = scipy.optimize.least_squares(
            lambda y, args=args: np.asarray(residuals(y, args)),
            start,
            jac=lambda y, args=args: np.asarray(slopes(y, args)),
            bounds=(low, high),
            xtol=1e-15, ftol=1e-15, gtol=1e-12,
        )  # fmt: skip
        value = np.asarray(found.value)
        at_bounds += int(np.sum((value == low) | (value == high)))
        cost = float(half_squares(residuals(found.value, args)))
        # Observed 4e-15 above at most, which is rounding.
        assert cost <= other.cost * (1.0 + 1e-12)
        assert ((value >= low) & (value <= high)).all()
        # Observed 16.
        assert int(found.stats["num_steps"]) < 30
    assert at_bounds > 10


def test_derivatives_at_bounds_are_those_of_solving_again():
    step = 1e-5

    def best(numbers, times, start):
        return solved((times, numbers[10:]), start, numbers[:5], numbers[5:10]).value

    @jax.jit
    def slopes_of(numbers, times, start):
        moved = numbers[None] + step * jnp.concatenate([jnp.eye(50), -jnp.eye(50)])
        ends = jax.vmap(best, (0, None, None))(moved, times, start)
        return jax.jacrev(best)(numbers, times, start), jax.jacfwd(best)(numbers, times, start), ends

    for seed in range(4):
        args, start, low, high = random_curve(seed)
        numbers = jnp.concatenate([low, high, args[1]])
        slopes, forward, ends = slopes_of(numbers, args[0], start)
        np.testing.assert_allclose(forward, slopes, rtol=1e-9, atol=1e-11)
        up, down = np.reshape(ends, (2, 50, 5))
        # Observed 2e-8: that of the solution, over the step.
        np.testing.assert_allclose(slopes, (up - down).T / (2.0 * step), rtol=0, atol=1e-6)


def test_a_batch_is_each_alone():
    problems = [random_curve(seed) for seed in range(5)]
    together = jax.tree.map(lambda *leaves: jnp.stack(leaves), *problems)
    many = jax.jit(jax.vmap(lambda *problem: solved(*problem).value))(*together)
    np.testing.assert_allclose(many, [solved(*problem).value for problem in problems], rtol=1e-9)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_structures_keep_their_types(dtype):
    def residuals(y, wanted):
        return {"first": 2.0 * y["a"] - wanted, "second": y["b"] + y["a"]}

    start = {"a": jnp.zeros(3, dtype), "b": jnp.ones((), dtype)}
    lower = {"a": jnp.array([1.0, 0.0, 0.0]), "b": 0.0}
    wanted = jnp.arange(3.0, dtype=dtype)
    found = optx.least_squares(
        residuals, BoundedLevenbergMarquardt(), start, args=wanted, options={"lower": lower}
    )
    assert found.value["a"].dtype == found.value["b"].dtype == dtype
    # b stays at 0, so that a minimises (2 a - wanted)^2 + a^2, from a start outside of its bounds.
    np.testing.assert_allclose(found.value["a"], [1.0, 0.4, 0.8], rtol=1e-6)
    assert float(found.value["b"]) == 0.0


def test_what_nothing_determines_changes_least():
    """Of three unknowns with one sum, each moves by the square of what it costs."""
    found = optx.least_squares(
        lambda y, _: jnp.sum(y)[None] - 4.0,
        BoundedLevenbergMarquardt(1e-12, 1e-12),
        jnp.array([1.0, 0.0, 0.0]),
        options={"scale": jnp.array([1.0, 1.0, 2.0]), "upper": jnp.array([1.0, 9.0, 9.0])},
    )
    np.testing.assert_allclose(found.value, [1.0, 2.4, 0.6], atol=1e-7)


def test_too_few_steps_and_no_numbers_are_reported():
    args, start, low, high = random_curve(0)
    few = solved(args, start, low, high, max_steps=2, throw=False)
    assert few.result == optx.RESULTS.nonlinear_max_steps_reached
    with pytest.raises(Exception, match="maximum number of steps"):
        solved(args, start, low, high, max_steps=2)
    bad = solved((args[0], args[1].at[0].set(jnp.nan)), start, low, high, throw=False)
    assert bad.result == optx.RESULTS.nonfinite


def test_what_overflows_is_no_answer():
    """Steps far out of this exponential are infinite, and the way back from them leads to 0."""
    found = optx.least_squares(
        lambda y, _: jnp.exp(y) - 1.0, BoundedLevenbergMarquardt(), jnp.array([-12.0], jnp.float32)
    )
    np.testing.assert_allclose(found.value, [0.0], atol=1e-6)


def test_no_number_anywhere_is_a_failure():
    found = optx.least_squares(
        lambda y, _: y * jnp.nan, BoundedLevenbergMarquardt(), jnp.array([-3.0]), throw=False
    )
    assert found.result == optx.RESULTS.nonfinite


def test_single_precision_comes_to_an_end():
    """Linear problems of condition 1000, whose cost is lost in rounding near the optimum."""
    rng = np.random.default_rng(0)
    turn, _, back = np.linalg.svd(rng.normal(size=(100, 9, 5)), full_matrices=False)
    matrices = jnp.asarray(turn * np.geomspace(1.0, 1e-3, 5) @ back, jnp.float32)
    right = jnp.asarray(rng.normal(size=(100, 9)), jnp.float32)

    def steps(matrix, right):
        def residuals(y, of):
            return of[0] @ y - of[1]

        start = jnp.zeros(5, jnp.float32)
        found = optx.least_squares(
            residuals, BoundedLevenbergMarquardt(), start, args=(matrix, right), throw=False
        )
        return found.stats["num_steps"]

    # Observed: 15.
    assert int(np.max(jax.jit(jax.vmap(steps))(matrices, right))) < 32


def test_what_a_function_says_besides_is_of_the_answer():
    def rosenbrock(y, _):
        return jnp.stack([10.0 * (y[1] - y[0] ** 2), 1.0 - y[0]]), y

    # Steps 3 and 4 are taken back, step 5 is kept.
    for most in (1, 4, 5):
        found = optx.least_squares(
            rosenbrock,
            BoundedLevenbergMarquardt(),
            jnp.array([-1.2, 1.0]),
            has_aux=True,
            max_steps=most,
            throw=False,
        )
        np.testing.assert_array_equal(found.aux, found.value)


def test_what_has_no_room_follows_its_bounds():
    def best(bound):
        return optx.least_squares(
            lambda y, _: y - 1.0,
            BoundedLevenbergMarquardt(),
            jnp.zeros(2),
            options={"lower": bound, "upper": bound},
            adjoint=BoundedImplicitAdjoint(),
        ).value

    np.testing.assert_allclose(jax.jit(jax.jacobian(best))(jnp.array(1.0)), [1.0, 1.0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"uper": 1.0}, "there is no option 'uper'; expected some of"),
        ({"upper": {"a": 1.0}}, "bounds and scale are one number for all of y, or have its structure"),
    ],
)
def test_options_that_mean_nothing_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        optx.least_squares(lambda y, _: y, BoundedLevenbergMarquardt(), jnp.zeros(2), options=options)


class Cubed(eqx.Module):
    """What y is for a size: its third power, and 0."""

    size: jax.Array

    def condition(self, y):
        return y - jnp.stack([self.size**3, 0.0])


def test_a_condition_gives_the_derivative():
    """The function that is solved says nothing of the derivative."""

    def found(size):
        still = jax.lax.stop_gradient(size) ** 3
        return optx.least_squares(
            lambda y, _: y - jnp.stack([still, 0.0]),
            BoundedLevenbergMarquardt(),
            jnp.ones(2),
            args=Cubed(size),
            adjoint=ConditionAdjoint(),
        ).value

    at = jnp.array(2.0)
    value, forward, reverse = jax.jit(lambda at: (found(at), jax.jacfwd(found)(at), jax.jacrev(found)(at)))(
        at
    )
    np.testing.assert_allclose(value, [8.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(forward, [12.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(reverse, [12.0, 0.0], atol=1e-9)


def test_steps_may_go_several_ways():
    """The best of the step's ends is taken, which arrives at once where the plain one would creep."""
    asked = []

    def paths(y, step, lower, upper, _):
        asked.append(step)
        return y + step.change, jnp.full_like(y, 3.0)

    found = optx.least_squares(
        lambda y, _: (y - 3.0) ** 4,
        BoundedLevenbergMarquardt(),
        jnp.zeros(2),
        options={"paths": paths},
        throw=False,
    )
    np.testing.assert_array_equal(found.value, 3.0)
    assert int(found.stats["num_steps"]) <= 3
    assert all(isinstance(step, BoundedStep) for step in asked)


def test_nothing_to_solve_for_is_solved():
    found = optx.least_squares(lambda y, _: jnp.ones(2), BoundedLevenbergMarquardt(), jnp.zeros(0))
    assert found.value.shape == (0,)


def test_jaxopt_starts_within_its_bounds():
    found = optx.least_squares(
        lambda y, _: y - 3.0, JaxoptLBFGSB(), jnp.array([9.0, -9.0]), options={"upper": 2.0, "lower": -1.0}
    )
    np.testing.assert_allclose(found.value, [2.0, 2.0])


def test_jaxopt_agrees():
    args, start, low, high = random_curve(1)
    second = solved(args, start, low, high, solver=JaxoptLBFGSB(atol=1e-8), max_steps=2000)
    # Observed 1e-10.
    np.testing.assert_allclose(second.value, solved(args, start, low, high).value, atol=1e-6)


def banded(seed, frames=7, rows=5, size=2):
    rng = np.random.default_rng(seed)

    def normal(*shape):
        return jnp.asarray(rng.normal(size=shape))

    number = np.arange(frames)[:, None]
    jacobian = BandedJacobian(
        normal(frames, rows, size), normal(frames, size) * (number >= 2), normal(frames, size) * (number >= 1)
    )
    moves = jnp.asarray(rng.integers(0, 2, size=(frames, size)), dtype=float)
    damped = DampedOperator(jacobian, moves, jnp.asarray(rng.uniform(0.1, 1.0, size=(frames, size))))
    vector = jax.tree.map(lambda leaf: normal(*leaf.shape), damped.out_structure())
    return damped, vector


@pytest.mark.parametrize("frames", [1, 2, 7])
def test_the_banded_solver_is_the_dense_one(frames):
    @eqx.filter_jit
    def answers(damped, vector):
        by = [lx.linear_solve(damped, vector, solver).value for solver in (BandedQR(), lx.QR())]
        return *by, damped.T.mv(vector), damped.as_matrix()

    damped, vector = banded(0, frames=frames)
    found, dense, pulled, matrix = answers(damped, vector)
    # Observed 4e-16.
    np.testing.assert_allclose(found, dense, atol=1e-13)
    flat = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(vector)])
    np.testing.assert_allclose(np.ravel(pulled), np.asarray(matrix).T @ flat, atol=1e-13)


def test_the_banded_solver_is_differentiable():
    damped, vector = banded(1)

    def dense(damped, vector):
        matrix = damped.as_matrix()
        flat = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(vector)])
        return jnp.linalg.solve(matrix.T @ matrix, matrix.T @ flat)

    weights = jnp.asarray(np.random.default_rng(2).normal(size=14))
    slopes, expected = (
        jax.jit(jax.grad(lambda *of, by=by: weights @ jnp.ravel(by(*of)), argnums=(0, 1)))(damped, vector)
        for by in (solve_banded, dense)
    )
    for one, other in zip(jax.tree.leaves(slopes), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11)


def test_the_banded_solver_refuses_other_operators():
    with pytest.raises(ValueError, match="operator is MatrixLinearOperator; BandedQR solves damped banded"):
        lx.linear_solve(lx.MatrixLinearOperator(jnp.eye(2)), jnp.ones(2), BandedQR())

"""Levenberg-Marquardt within bounds, a solver of Optimistix, and its derivative where bounds are active."""

import functools as ft
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, PyTree

_Operator = TypeVar("_Operator", bound=type[lx.AbstractLinearOperator])

_GENTLE = 1e-3
"""Damping after the first step that did not help."""

_HOPELESS = 1e8
"""Damping at which no step is left to take."""


_OPTIONS = {"lower", "upper", "scale", "linearise", "rounding", "paths"}

_NOISE = 64.0
"""Roundings by which a cost may be off."""


class BoundedState(eqx.Module):
    """Between two steps.

    Attributes:
        found: what the function returns at y: its residuals, and what it has beside them.
        cost: half the sum of squared residuals.
        damping: of the next step.
        arrived: whether the last step changed nothing beyond the tolerance.
    """

    found: tuple[PyTree[Array], PyTree[Array]]
    cost: Float[Array, ""]
    damping: Float[Array, ""]
    arrived: Bool[Array, ""]


class BoundedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt within bounds, for `optimistix.least_squares`.

    Minimises |r(y)|^2 / 2 subject to lower <= y <= upper. With J = dr/dy, an element of y at a bound that the
    gradient J^T r pushes against stays during a step. The others take the step d that minimises

        |J d + r|^2 + damping |scale d|^2

    and are cut off at their bounds. With enough damping that is a step of projected gradient descent, so it
    helps in the end (Bertsekas 1982, Projected Newton Methods). Damping is divided by 32 after a step that
    lowers the cost, and multiplied by 16 otherwise. It starts so small that steps are those of Gauss-Newton
    wherever these help. Where J has not full rank, the least of the equally good steps is taken, as measured
    by `scale`.

    Give `adjoint=BoundedImplicitAdjoint()` to differentiate: elements at active bounds then follow these.
    A start outside the bounds is moved to them. That lower <= upper is not checked. Without a finite cost
    the result is `RESULTS.nonfinite`.

    Attributes:
        rtol: relative tolerance: the solve ends when a step changes y and r by no more, or at a damping at
            which no step helps.
        atol: absolute tolerance, added to the other.
        norm: of y and of r, which the tolerances are for.
        linear_solver: of Lineax, for the steps' linear least squares of full rank, such as QR or SVD.

    The `options` of `least_squares` may have

    - `lower`, `upper`: bounds: one number, or of the structure of y with -inf or inf where there is none;
    - `scale`: factors of the elements of d, in the same form; 1 by default;
    - `linearise`: a function of (fn, y, args) that returns the residuals and J as an operator of Lineax, for
      a J of some structure, which goes with `linear_solver`. Both may be multiplied by one factor, which is
      as if damping were divided by its square. By default J is dense, with its longest column scaled to 1;
    - `rounding`: a function of (fn, y, args) that returns the size of rounding in each residual: the solve
      ends when a step changes no residual by more, instead of by the tolerances;
    - `paths`: a function of (y, step, lower, upper, args) that returns several ends of a `BoundedStep`, of
      which the best is taken. By default y + d alone.

    Example:
        >>> import optimistix as optx
        >>> from focusjax.solvers import BoundedImplicitAdjoint, BoundedLevenbergMarquardt
        >>> def rosenbrock(y, _):
        ...     return jnp.stack([10.0 * (y[1] - y[0] ** 2), 1.0 - y[0]])
        >>> def best(upper):
        ...     return optx.least_squares(
        ...         rosenbrock, BoundedLevenbergMarquardt(), jnp.array([-1.0, 1.0]),
        ...         options={"upper": jnp.stack([upper, 2.0])}, adjoint=BoundedImplicitAdjoint(),
        ...     ).value
        >>> best(jnp.array(0.5)).round(4).tolist(), jax.jacobian(best)(jnp.array(0.5)).round(4).tolist()
        ([0.5, 0.25], [1.0, 1.0])
    """

    rtol: float = 1e-6
    atol: float = 1e-6
    norm: Callable[[PyTree], Float[Array, ""]] = optx.max_norm
    linear_solver: lx.AbstractLinearSolver = lx.QR()

    def init(
        self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any
    ) -> BoundedState:
        """The cost at the start, moved within the bounds."""
        unknown = sorted(set(options) - _OPTIONS)
        if unknown:
            raise ValueError(f"there is no option {unknown[0]!r}; expected some of {sorted(_OPTIONS)}")
        found = fn(_inside(y, *bounds_of(options, y)), args)
        cost = _cost(found[0])
        return BoundedState(found, cost, jnp.full_like(cost, _least(cost)), jnp.array(False))

    def step(
        self, fn: Any, y: Any, args: Any, options: Any, state: BoundedState, tags: Any
    ) -> tuple[Any, BoundedState, Any]:
        """One step, taken where it helps."""
        lower, upper = bounds_of(options, y)
        y = _inside(y, lower, upper)
        residual, jacobian = options.get("linearise", _dense)(fn, y, args)
        root = jax.tree.map(lambda s: jnp.sqrt(state.damping) * s, _like(options.get("scale", 1.0), y))
        step = bounded_step(y, residual, jacobian, lower, upper, root, self.linear_solver)
        ends = (
            options["paths"](y, step, lower, upper, args) if "paths" in options else (_sum(y, step.change),)
        )
        # What is held by a bound stays, whatever path the rest takes.
        ends = [
            jax.tree.map(
                lambda y, m, end: jnp.where(m > 0.0, end, y), y, step.moves, _inside(end, lower, upper)
            )
            for end in ends
        ]
        moved, new, cost = _best_of(fn, ends, args)
        shift = jax.tree.map(jnp.subtract, new[0], state.found[0])
        better = cost < state.cost
        calmer = jnp.maximum(16.0 * state.damping, _GENTLE)
        damping = jnp.where(better, jnp.maximum(state.damping / 32.0, _least(cost)), calmer)
        if "rounding" in options:
            arrived = _all_within(shift, options["rounding"](fn, moved, args))
        else:
            arrived = self._within(jax.tree.map(jnp.subtract, moved, y), moved) & self._within(shift, new[0])
            # Near the optimum the gradient is more exact than the cost, in which rounding hides its fall.
            better |= cost - state.cost <= _NOISE * jnp.finfo(cost.dtype).eps * state.cost
        better &= jnp.isfinite(cost)
        y, found = jax.tree.map(ft.partial(jnp.where, better), (moved, new), (y, state.found))
        least = jnp.minimum(cost, state.cost)
        return y, BoundedState(found, least, damping, arrived | (damping > _HOPELESS)), found[1]

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: BoundedState, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether nothing changes any more, and whether the cost is finite."""
        lost = state.arrived & ~jnp.isfinite(state.cost)
        return state.arrived, optx.RESULTS.where(lost, optx.RESULTS.nonfinite, optx.RESULTS.successful)

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: Any, tags: Any, result: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        """Nothing is left to do."""
        return y, aux, {}

    def _within(self, change: PyTree, of: PyTree) -> Bool[Array, ""]:
        return self.norm(change) <= self.atol + self.rtol * self.norm(of)


class BoundedImplicitAdjoint(optx.AbstractAdjoint):
    """Derivatives of a least-squares solve within bounds, by the implicit function theorem.

    What lies at a bound that the gradient pushes against has the derivative of the bound. In the rest the
    gradient vanishes, and stays so.

    Attributes:
        linear_solver: of Lineax, for the system with the Hessian of |r(y)|^2 / 2; where that is singular,
            `lineax.AutoLinearSolver(well_posed=False)` says that what is not determined does not move.
    """

    linear_solver: lx.AbstractLinearSolver = lx.AutoLinearSolver(well_posed=None)

    def apply(self, primal_fn: Any, rewrite_fn: Any, inputs: Any, tags: frozenset[object]) -> Any:
        """Runs the solve, and says how its answer follows what it depends on."""
        return optx.ImplicitAdjoint(self.linear_solver).apply(primal_fn, _optimality, inputs, tags)


class ConditionAdjoint(optx.AbstractAdjoint):
    """Derivatives of a solve by the implicit function theorem, from a condition that its answer y meets.

    For a function, quick to evaluate, that has another derivative than the problem for which it stands. The
    solve's `args` have a method `condition` of y, which is 0 at the answer, and of the structure of y.

    Attributes:
        linear_solver: of Lineax, for the system with the condition's derivative by y.
    """

    linear_solver: lx.AbstractLinearSolver = lx.AutoLinearSolver(well_posed=None)

    def apply(self, primal_fn: Any, rewrite_fn: Any, inputs: Any, tags: frozenset[object]) -> Any:
        """Runs the solve, and says how its answer follows what it depends on."""
        return optx.ImplicitAdjoint(self.linear_solver).apply(primal_fn, _condition, inputs, tags)


def _optimality(optimum: Any, _: Any, inputs: Any) -> Any:
    """What vanishes at the optimum: the gradient, or the distance from an active bound."""
    fn, _, _, args, options, *_ = inputs
    lower, upper = bounds_of(options, optimum)
    gradient = jax.grad(lambda y: half_squares(fn(y, args)[0]))(optimum)

    def one(y: Array, low: Array, high: Array, slope: Array) -> Array:
        held = jnp.where((y <= low) & ((slope > 0.0) | (low >= high)), y - low, slope)
        return jnp.where((y >= high) & (slope < 0.0), y - high, held)

    return jax.tree.map(one, optimum, lower, upper, gradient)


def _condition(optimum: Any, _: Any, inputs: Any) -> Any:
    """What the arguments say is 0 at the optimum."""
    args = inputs[3]
    return args.condition(optimum)


# Optimistix takes plain functions only; annotations that are checked as tests run wrap them.
_optimality, _condition = (getattr(each, "__wrapped__", each) for each in (_optimality, _condition))


def without_symmetry(operator: _Operator) -> _Operator:
    """Says to Lineax that operators of a class are neither symmetric nor definite."""
    for check in (lx.is_symmetric, lx.is_positive_semidefinite, lx.is_negative_semidefinite):
        check.register(operator)(lambda _: False)
    return operator


@without_symmetry
class DampedOperator(lx.AbstractLinearOperator):
    """d to (J (moves d), root d): a Jacobian of which some columns are held, above a diagonal.

    Attributes:
        jacobian: J.
        moves: 1 for what may change, and 0 for what is held; as d.
        root: roots of the damping; as d.
    """

    jacobian: lx.AbstractLinearOperator
    moves: PyTree[Array]
    root: PyTree[Array]

    def mv(self, vector: PyTree[Array]) -> PyTree[Array]:
        return (
            self.jacobian.mv(jax.tree.map(jnp.multiply, self.moves, vector)),
            jax.tree.map(jnp.multiply, self.root, vector),
        )

    def as_matrix(self) -> Float[Array, "m k"]:
        moves, root = (ravel_pytree(each)[0] for each in (self.moves, self.root))
        return jnp.concatenate([self.jacobian.as_matrix() * moves[None], jnp.diag(root)])

    def transpose(self) -> lx.AbstractLinearOperator:
        return transposed(self)

    def in_structure(self) -> PyTree[jax.ShapeDtypeStruct]:
        return self.jacobian.in_structure()

    def out_structure(self) -> PyTree[jax.ShapeDtypeStruct]:
        return self.jacobian.out_structure(), self.in_structure()


class BoundedStep(eqx.Module):
    """A step from y; all of its structure.

    Attributes:
        change: d.
        moves: 1 for what may change, and 0 for what a bound holds.
        gradient: of |r|^2 / 2, by the residuals and J that the step was made of.
    """

    change: PyTree[Array]
    moves: PyTree[Array]
    gradient: PyTree[Array]


def bounded_step(
    y: PyTree[Array],
    residual: PyTree[Array],
    jacobian: lx.AbstractLinearOperator,
    lower: PyTree[Array],
    upper: PyTree[Array],
    root: PyTree[Array],
    linear_solver: lx.AbstractLinearSolver,
) -> BoundedStep:
    """A damped Gauss-Newton step of what no bound holds back.

    Args:
        y: where it starts.
        residual: there.
        jacobian: of the residual.
        lower: bounds; nothing that lies at one may go beyond.
        upper: the same.
        root: roots of the damping of the elements' squared changes.
        linear_solver: for the step's linear least-squares problem.
    """
    gradient = jacobian.T.mv(residual)

    def free(y: Array, low: Array, high: Array, slope: Array) -> Array:
        stuck = ((y <= low) & (slope > 0.0)) | ((y >= high) & (slope < 0.0))
        return jnp.where(stuck, jnp.zeros_like(y), jnp.ones_like(y))

    moves = jax.tree.map(free, y, lower, upper, gradient)
    right = jax.tree.map(jnp.negative, residual), jax.tree.map(jnp.zeros_like, y)
    change = lx.linear_solve(DampedOperator(jacobian, moves, root), right, linear_solver, throw=False).value
    return BoundedStep(jax.tree.map(jnp.multiply, change, moves), moves, gradient)


def half_squares(residual: PyTree[Array]) -> Float[Array, ""]:
    """Half the sum of all squares."""
    squares = [jnp.sum(leaf**2) for leaf in jax.tree.leaves(residual)]
    return 0.5 * sum(squares[1:], squares[0])


def _cost(residual: PyTree[Array]) -> Float[Array, ""]:
    """Half the sum of all squares; infinite where it is no number."""
    cost = half_squares(residual)
    return jnp.where(jnp.isnan(cost), jnp.inf, cost)


def _best_of(fn: Any, ends: Sequence[PyTree], args: Any) -> tuple[PyTree, Any, Float[Array, ""]]:
    """The end of least cost, what `fn` returns there, and the cost."""
    if len(ends) == 1:
        found = fn(ends[0], args)
        return ends[0], found, _cost(found[0])
    tried = jax.tree.map(lambda *leaves: jnp.stack(leaves), *ends)
    found = jax.vmap(lambda end: fn(end, args))(tried)
    cost = jax.vmap(_cost)(found[0])
    best = jnp.argmin(cost)
    return *jax.tree.map(lambda leaf: leaf[best], (tried, found)), cost[best]


def _dense(fn: Any, y: Any, args: Any) -> tuple[Any, lx.AbstractLinearOperator]:
    """The residuals and their Jacobian as an array, over the length of its longest column."""
    (slopes, residual) = jax.jacfwd(lambda y: (fn(y, args)[0],) * 2, has_aux=True)(y)
    structure = jax.eval_shape(lambda: residual)
    matrix = lx.PyTreeLinearOperator(slopes, structure)
    length = jnp.sqrt(jnp.max(jnp.sum(matrix.as_matrix() ** 2, axis=0), initial=0.0))
    over = 1.0 / jnp.where(length > 0.0, length, 1.0)
    slopes, residual = jax.tree.map(lambda leaf: over * leaf, (slopes, residual))
    return residual, lx.PyTreeLinearOperator(slopes, structure)


def bounds_of(options: dict[str, Any], y: PyTree[Array]) -> tuple[PyTree[Array], PyTree[Array]]:
    """Lower and upper bounds of all elements of y."""
    return _like(options.get("lower", -jnp.inf), y), _like(options.get("upper", jnp.inf), y)


def _like(value: Any, y: PyTree[Array]) -> PyTree[Array]:
    """`value` for every element of y: of its structure, or one for all."""
    if jax.tree.structure(value) != jax.tree.structure(y):
        if jax.tree.structure(value) != jax.tree.structure(0.0):
            raise ValueError(
                "bounds and scale are one number for all of y, or have its structure; y has"
                f" {jax.tree.structure(y)}, and one of them {jax.tree.structure(value)}; give -inf or inf"
                " where there is no bound"
            )
        return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(value, leaf.dtype), leaf.shape), y)
    return jax.tree.map(
        lambda each, leaf: jnp.broadcast_to(jnp.asarray(each, leaf.dtype), leaf.shape), value, y
    )


def _least(cost: Float[Array, ""]) -> float:
    """The least damping: that of changes of r by a thousand roundings."""
    return float((1e3 * jnp.finfo(cost.dtype).eps) ** 2)


def _inside(y: PyTree[Array], lower: PyTree[Array], upper: PyTree[Array]) -> PyTree[Array]:
    return jax.tree.map(jnp.clip, y, lower, upper)


def _sum(y: PyTree[Array], change: PyTree[Array]) -> PyTree[Array]:
    return jax.tree.map(jnp.add, y, change)


def _all_within(change: PyTree[Array], limit: PyTree[Array]) -> Bool[Array, ""]:
    within = jax.tree.map(lambda change, limit: jnp.all(jnp.abs(change) <= limit), change, limit)
    return jnp.all(jnp.stack(jax.tree.leaves(within)))


def transposed(operator: lx.AbstractLinearOperator) -> lx.AbstractLinearOperator:
    """The transpose of an operator, by JAX."""
    return lx.FunctionLinearOperator(operator.mv, operator.in_structure()).T

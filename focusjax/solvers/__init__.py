"""Solvers of least squares within bounds, for Optimistix and Lineax. They know nothing of lenses."""

from focusjax.solvers._banded import BandedJacobian as BandedJacobian
from focusjax.solvers._banded import BandedQR as BandedQR
from focusjax.solvers._banded import solve_banded as solve_banded
from focusjax.solvers._bounded import BoundedImplicitAdjoint as BoundedImplicitAdjoint
from focusjax.solvers._bounded import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
from focusjax.solvers._bounded import BoundedStep as BoundedStep
from focusjax.solvers._bounded import ConditionAdjoint as ConditionAdjoint
from focusjax.solvers._bounded import DampedOperator as DampedOperator
from focusjax.solvers._bounded import bounded_step as bounded_step
from focusjax.solvers._bounded import half_squares as half_squares
from focusjax.solvers._hessian import solve_hessian as solve_hessian
from focusjax.solvers._jaxopt import JaxoptLBFGSB as JaxoptLBFGSB

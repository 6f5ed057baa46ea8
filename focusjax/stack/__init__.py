"""Focal stacks: the fewest shots that make everything sharp, their pictures, and one made of them."""

from focusjax.stack._command import command as command
from focusjax.stack._merge import merge as merge
from focusjax.stack._plan import StackPlan as StackPlan
from focusjax.stack._plan import StackShot as StackShot
from focusjax.stack._plan import fewest_points as fewest_points
from focusjax.stack._plan import plan_stack as plan_stack
from focusjax.stack._run import take_stack as take_stack

"""Numerical stability: hard wishes, glass and pictures in both precisions, against the truth."""

from focusjax.hard_cases._check import Check as Check
from focusjax.hard_cases._command import command as command
from focusjax.hard_cases._run import NAMES as NAMES
from focusjax.hard_cases._run import hard_cases as hard_cases

"""Data sets of random pictures with ground truth: defocused and sharp, depth, and blur."""

from focusjax.dataset._distributions import Distribution as Distribution
from focusjax.dataset._read import Dataset as Dataset
from focusjax.dataset._read import load_dataset as load_dataset
from focusjax.dataset._run import DatasetResults as DatasetResults
from focusjax.dataset._run import make_dataset as make_dataset
from focusjax.dataset._spec import Spec as Spec
from focusjax.dataset._spec import load_spec as load_spec
from focusjax.dataset._spec import spec_of as spec_of

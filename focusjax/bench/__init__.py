"""Speed against error: every method on the same scenes, against a converged picture."""

from focusjax.bench._case import Case as Case
from focusjax.bench._case import baked as baked
from focusjax.bench._case import case_from_config as case_from_config
from focusjax.bench._case import resized as resized
from focusjax.bench._equal import Reach as Reach
from focusjax.bench._equal import time_to_reach as time_to_reach
from focusjax.bench._methods import METHODS as METHODS
from focusjax.bench._methods import ChoiceError as ChoiceError
from focusjax.bench._methods import Method as Method
from focusjax.bench._methods import chosen_methods as chosen_methods
from focusjax.bench._reference import Reference as Reference
from focusjax.bench._reference import reference_picture as reference_picture
from focusjax.bench._run import CaseResults as CaseResults
from focusjax.bench._run import Results as Results
from focusjax.bench._run import Row as Row
from focusjax.bench._run import speed_error as speed_error
from focusjax.bench._save import FILES as FILES
from focusjax.bench._save import save_results as save_results
from focusjax.bench._score import near_silhouettes as near_silhouettes

"""A config and a scene to begin with."""

from focusjax.starter._make import SCHEMA as SCHEMA
from focusjax.starter._make import make_starter as make_starter

"""The checker that the import hook puts on every annotated function of focusjax."""

from beartype import BeartypeConf, beartype

# PEP 484: an int is welcome where a float is expected.
check = beartype(conf=BeartypeConf(is_pep484_tower=True))

"""Names of items: readable, no two alike, and good for folders everywhere."""

import hashlib
import re
from collections import Counter
from collections.abc import Sequence

_LONGEST = 120
"""Bytes; file systems allow 255, and temporary names need some."""
_TAKEN = frozenset({"", "summary.csv", "summary.json", "summary.html"})


def safe_names(wanted: Sequence[str], identities: Sequence[str]) -> list[str]:
    """A folder name for each of the `wanted` names, like it if possible.

    What not every file system takes becomes "_". A name that is too long, that is like another's, or of
    which nothing is left, ends in eight digits of a hash of its identity. So a name depends on nothing but
    the item itself, unless two items want the same.

    Args:
        wanted: one name per item.
        identities: what makes each item what it is.

    Example:
        >>> safe_names(["town,lens.f_number=2", "a b?"], ["1", "2"])
        ['town,lens.f_number=2', 'a_b']
    """
    cleaned = [re.sub(r"[^\w.,=+-]+", "_", name).strip("._-, ") for name in wanted]
    # Some file systems do not distinguish capitals from small letters.
    times = Counter(name.casefold() for name in cleaned)
    return [
        name
        if times[name.casefold()] == 1 and name.casefold() not in _TAKEN and len(name.encode()) <= _LONGEST
        else _hashed(name, identity)
        for name, identity in zip(cleaned, identities, strict=True)
    ]


def _hashed(name: str, identity: str) -> str:
    digits = hashlib.sha256(identity.encode()).hexdigest()[:8]
    head = name.encode()[: _LONGEST - 9].decode(errors="ignore").rstrip("._-, ")
    return f"{head}-{digits}" if head else digits

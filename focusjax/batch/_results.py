"""What came of each item, read back from what it left on disk."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from focusjax.batch._folder import done_before
from focusjax.batch._items import Item
from focusjax.io import load_json

_KEPT_PARTS = ("lens", "wishes", "solver")


@dataclass(frozen=True)
class ItemResult:
    """What came of one item.

    Attributes:
        item: what was to be done.
        status: "done", "failed", or "waiting" to be done.
        message: of a failed item, what went wrong; of one that is done, which wishes do not count and why.
        kept: done by an earlier batch and not again.
        facts: of an item that is done: its seconds and warnings, and the lens, wishes and solver of its
            report.json.
    """

    item: Item
    status: Literal["done", "failed", "waiting"]
    message: str = ""
    kept: bool = False
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def counted(self) -> list[dict[str, Any]]:
        """The wishes that count, as report.json has them."""
        return [wish for wish in self.facts.get("wishes", ()) if wish["counts"]]

    @property
    def wishes_met(self) -> int:
        """How many of the wishes that count are met."""
        return sum(wish["met"] for wish in self.counted)

    @property
    def worst_wish(self) -> dict[str, Any] | None:
        """The wish that counts and is missed by most, as report.json has it."""
        return max(self.counted, key=lambda wish: abs(float(wish["residual_px"])), default=None)

    @property
    def worst_error(self) -> float:
        """Pixels by which that wish is missed; infinite where nothing was solved."""
        return math.inf if self.worst_wish is None else abs(float(self.worst_wish["residual_px"]))


@dataclass(frozen=True)
class BatchResults:
    """What came of a batch.

    Attributes:
        folder: where its files are.
        solve_only: whether pictures were left out.
        results: one per item, in their order.
    """

    folder: Path
    solve_only: bool
    results: tuple[ItemResult, ...]

    @property
    def failed(self) -> list[ItemResult]:
        """The items that failed."""
        return self.having("failed")

    def having(self, status: str) -> list[ItemResult]:
        """The items of a status."""
        return [result for result in self.results if result.status == status]

    @property
    def keys(self) -> list[str]:
        """Every key that some item changes."""
        return list(dict.fromkeys(key for result in self.results for key, _ in result.item.changes))


def result_of(item: Item, folder: Path, *, kept: bool) -> ItemResult:
    """The result of an item whose folder lies, whole, in `folder`."""
    before = done_before(folder / item.name) or {}
    report = load_json(folder / item.name / "report.json") or {}
    facts = {key: before.get(key) for key in ("seconds", "warnings")}
    idle = [wish for wish in report.get("wishes") or () if not wish["counts"] and wish.get("note")]
    message = "; ".join(f"{wish['name']} is {wish['note']} and does not count" for wish in idle)
    return ItemResult(
        item, "done", message, kept=kept, facts=facts | {key: report.get(key) for key in _KEPT_PARTS}
    )

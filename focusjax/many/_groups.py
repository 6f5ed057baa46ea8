"""Tasks that wait, by their groups."""

from collections import deque
from collections.abc import Iterable, Sequence

from focusjax.many._task import Task


class Waiting:
    """Tasks that nobody does yet, in their order within each group."""

    def __init__(self, tasks: Iterable[Task]):
        self._groups: dict[str, deque[Task]] = {}
        for task in tasks:
            self._groups.setdefault(task.group, deque()).append(task)

    def __len__(self) -> int:
        return sum(map(len, self._groups.values()))

    def __bool__(self) -> bool:
        return bool(self._groups)

    def take(self, own: str | None, others: Iterable[str]) -> Task:
        """The task to do next: of the `own` group, or else of the largest that nobody else is at.

        Args:
            own: the group of the worker's last task; None for a worker that had none.
            others: the groups that other workers are at.
        """
        group = own
        if group not in self._groups:
            busy = set(others)
            group = max(self._groups, key=lambda name: (name not in busy, len(self._groups[name])))
        task = self._groups[group].popleft()
        if not self._groups[group]:
            del self._groups[group]
        return task

    def put_back(self, tasks: Sequence[Task]) -> None:
        """Tasks that were not done after all."""
        for task in tasks:
            self._groups.setdefault(task.group, deque()).appendleft(task)

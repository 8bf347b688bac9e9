"""Plays a cluster of Ray in this process: tasks are pickled, run when asked for, or killed."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from types import SimpleNamespace
from typing import Any


class RayError(Exception):
    """As Ray's: the base of all."""


class RayTaskError(RayError):
    """As Ray's: what a task raised."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(f"traceback\n{type(cause).__name__}: {cause}")
        self.cause = cause


class TaskOSError(RayTaskError, OSError):
    """As Ray makes it: what a task raised, of both kinds."""


@dataclass(frozen=True)
class Reference:
    number: int
    cluster: int

    def hex(self) -> str:
        # no two clusters share one: what processes of nodes keep goes by it
        return f"{self.cluster}-{self.number}"


_CLUSTERS = count()


@dataclass
class PretendedRay:
    """What the command and its tasks call of Ray."""

    raised: Callable[[Any], Exception | None]
    """What becomes of a task in place of its results."""
    tasks: list[Any] = field(default_factory=list[Any])
    """As they were sent."""
    stored: list[bytes] = field(default_factory=list[bytes])
    number: int = field(default_factory=_CLUSTERS.__next__)
    options: dict[str, Any] = field(default_factory=dict[str, Any])
    """Of tasks, as they were asked for."""
    exceptions = SimpleNamespace(RayError=RayError, RayTaskError=RayTaskError)

    def is_initialized(self) -> bool:
        return True

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 1.0}

    def put(self, value: object) -> Reference:
        self.stored.append(pickle.dumps(value))
        return Reference(len(self.stored) - 1, self.number)

    def remote(self, **options: object) -> Callable[[Callable[[Any], object]], Any]:
        self.options = options

        def made(function: Callable[[Any], object]) -> Any:
            def sent(task: Any) -> tuple[Callable[[Any], object], int]:
                self.tasks.append(pickle.loads(pickle.dumps(task)))  # noqa: S301  (our own)
                return function, len(self.tasks) - 1

            return SimpleNamespace(remote=sent)

        return made

    def wait(self, tasks: Sequence[object], num_returns: int) -> tuple[list[object], list[object]]:
        return list(tasks[:num_returns]), list(tasks[num_returns:])

    def get(self, reference: Any) -> Any:
        if isinstance(reference, Reference):
            return pickle.loads(self.stored[reference.number])  # noqa: S301  (our own)
        function, number = reference
        error = self.raised(self.tasks[number])
        if error is not None:
            raise error
        return function(self.tasks[number])

    def cancel(self, task: object, *, force: bool) -> None:
        """Nothing runs."""

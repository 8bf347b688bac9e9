"""Answers requests in the process of a tool: one JSON request and one JSON answer per line."""

from __future__ import annotations

import json
import os
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

PROCESSOR_TIME = os.environ.get("MSNN_BENCHMARK_CLOCK") == "processor"
"""Whether an epoch is timed in seconds of processors, which other work on the machine leaves be."""

clock = time.process_time if PROCESSOR_TIME else time.perf_counter


class Contender(ABC):
    """One tool on one workload, ready to train."""

    build_seconds: float | None = None
    """Time to build what trains, where that is worth telling."""

    @abstractmethod
    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        """Trains `count` epochs; returns all seconds, and the loss of each epoch.

        With `fixed` the batches are in the data's order.
        """

    @abstractmethod
    def reset(self) -> None:
        """Restores the initial weights and a new optimiser."""

    def gradient(self, weights: dict[str, list[float]]) -> dict[str, list[float]]:
        """The gradient of the first fixed batch at these weights, by parameter."""
        raise ValueError(f"{type(self).__name__} gives no gradient: {sorted(weights)}")


def serve(make: Callable[[str], Contender]) -> None:
    """Answers requests until the input ends; the first line is the workload."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the tools print must not get between the answers
    contender = make(sys.stdin.readline())
    answer(answers, {"ready": True, "build_seconds": contender.build_seconds})
    for line in sys.stdin:
        request: dict[str, Any] = json.loads(line)
        if request["do"] == "epochs":
            seconds, losses = contender.epochs(request["count"], request["fixed"])
            answer(answers, {"seconds": seconds, "losses": losses})
        elif request["do"] == "gradient":
            answer(answers, contender.gradient(request["weights"]))
        else:
            contender.reset()
            answer(answers, {})


def answer(stream: Any, value: dict[str, Any]) -> None:
    stream.write(json.dumps(value) + "\n")
    stream.flush()

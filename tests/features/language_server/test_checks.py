"""What a check found of a text is told only as long as the text is that."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from threading import Event

from msnn.features.language_server.checks import Checks, OpenText
from msnn.features.language_server.knowledge import Examined, examine
from tests.features.language_server.marked import PLANT

_WRONG = PLANT.replace("gain * sum", "gian * sum")
_PATIENCE = 30.0
"""Seconds: longer than a check, and a test that fails has an end."""


class PretendedProcess:
    """Checks in this process; each check goes on until it is let."""

    def __init__(self) -> None:
        self.begun, self.let = Event(), Event()
        self.texts: list[str] = []

    def start(self) -> None:
        """It is there."""

    def stop(self) -> None:
        """Nothing runs."""

    def examine(
        self, path: str, text: str, unsaved: Mapping[str, str], gives_up: Callable[[], bool]
    ) -> Examined:
        self.texts.append(text)
        self.begun.set()
        self.let.wait(_PATIENCE)
        return examine(path, text, unsaved)


def test_what_is_wrong_with_an_older_text_is_not_told_of_a_newer_one() -> None:
    told: list[tuple[int | None, list[str]]] = []
    found = asyncio.run(_changed_meanwhile(told))
    assert found.texts == [_WRONG, PLANT]
    assert told == [(2, [])]


async def _changed_meanwhile(told: list[tuple[int | None, list[str]]]) -> PretendedProcess:
    """Replaces a text while it is checked, and waits for what is said of the second one."""
    over = asyncio.Event()

    def publish(address: str, opened: OpenText) -> None:
        del address
        told.append((opened.version, [each.diagnostic.code for each in opened.problems]))
        if opened.source.text == PLANT and opened.checked is opened.source:
            over.set()

    def complain(message: str) -> None:
        raise AssertionError(message)

    checks, process = Checks(publish, complain), PretendedProcess()
    checks._process = process  # pyright: ignore[reportAttributeAccessIssue]
    running = asyncio.create_task(checks.run())
    checks.put("file:///plant.msnn.yaml", "/plant.msnn.yaml", _WRONG, 1)
    await asyncio.to_thread(process.begun.wait, _PATIENCE)
    checks.put("file:///plant.msnn.yaml", "/plant.msnn.yaml", PLANT, 2)
    process.let.set()
    await asyncio.wait_for(over.wait(), _PATIENCE)
    checks.end()
    running.cancel()
    return process

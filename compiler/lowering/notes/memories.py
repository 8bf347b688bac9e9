"""Collects the states of layers and calls, one state per layer and signal."""

from __future__ import annotations

from collections.abc import Hashable

from compiler.ir.program import State


class Memories:
    """The states of layers and calls. Equal calls on the same signal share a state."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, tuple[Hashable, ...]], str] = {}
        self._calls: dict[str, int] = {}
        self._states: dict[str, State] = {}

    @property
    def states(self) -> tuple[State, ...]:
        """All states, in the order of first use."""
        return tuple(self._states.values())

    def name(self, owner: str, call: tuple[Hashable, ...]) -> str:
        """Name of the state of a call: `h.state`, and `h.state2` for a second signal."""
        key = (owner, call)
        if key not in self._names:
            number = self._calls[owner] = self._calls.get(owner, 0) + 1
            self._names[key] = f"{owner}.state{number if number > 1 else ''}"
        return self._names[key]

    def keep(self, state: State) -> None:
        """Adds a state with its next value and its start."""
        self._states[state.name] = state

"""The states that layers keep between steps, one set for each signal that a layer runs on."""

from __future__ import annotations

from compiler.program import NodeId, State


class Memories:
    """What layers remember; the same layer called on the same signal is the same memory."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, tuple[NodeId, ...]], str] = {}
        self._calls: dict[str, int] = {}
        self._states: dict[str, State] = {}

    @property
    def states(self) -> tuple[State, ...]:
        """All of them, in the order of first use."""
        return tuple(self._states.values())

    def name(self, layer: str, arguments: tuple[NodeId, ...]) -> str:
        """Name of the state of a call: `h.state`, and `h.state2` on a second signal."""
        key = (layer, arguments)
        if key not in self._names:
            number = self._calls[layer] = self._calls.get(layer, 0) + 1
            self._names[key] = f"{layer}.state{number if number > 1 else ''}"
        return self._names[key]

    def keep(self, state: State) -> None:
        """A state with its next value and its start."""
        self._states[state.name] = state

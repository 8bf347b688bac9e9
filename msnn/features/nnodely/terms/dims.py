"""Names the dimensions of a spec by size, so that values of one size are compatible."""

from __future__ import annotations

from collections.abc import Callable


class Dims:
    """The dimensions that a spec declares."""

    def __init__(self, free_name: Callable[[str], str]) -> None:
        self._free_name = free_name
        self._names: dict[tuple[str, int], str] = {}
        self._sizes: dict[str, int] = {}
        self._labelled: set[str] = set()

    def of(self, size: int, kind: str = "dim") -> str:
        """The dimension of that size and kind."""
        key = (kind, size)
        if key not in self._names:
            self._names[key] = self._free_name(f"{kind}{size}")
            self._sizes[self._names[key]] = size
        return self._names[key]

    def label(self, dim: str, index: int) -> str:
        """The label of an element, which adds labels to the dimension."""
        self._labelled.add(dim)
        return f"{dim}_{index}"

    def section(self) -> dict[str, int | list[str]]:
        """The `dims:` of the spec."""
        return {
            name: [f"{name}_{i}" for i in range(size)] if name in self._labelled else size
            for name, size in self._sizes.items()
        }

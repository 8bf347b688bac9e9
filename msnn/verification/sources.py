"""Says what checks of sources need to know of an export."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol


class Sources(Protocol):
    """A folder with C: `include`, `src`, perhaps `test`."""

    @property
    def folder(self) -> Path: ...

    @property
    def prefix(self) -> str:
        """What its names begin with."""
        ...

    @property
    def include(self) -> Path: ...

    @property
    def sources(self) -> tuple[Path, ...]: ...

    @property
    def model_sources(self) -> tuple[Path, ...]:
        """The sources without the self-test, as deployed."""
        ...


def includes(model: Sources) -> list[str]:
    """Where a harness finds the export and its vectors."""
    return [f"-I{model.include}", f"-I{model.folder / 'src'}", f"-I{model.folder / 'test'}"]

"""Compiles the sources of an export once for all programs that link the same objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from threading import Lock

from msnn.verification.host.levels import STANDARD
from msnn.verification.proof_step import run_tool
from msnn.verification.sources import Sources, includes
from msnn.verification.tools import Tool


@dataclass(slots=True)
class _Build:
    """The objects of one compiler with one set of flags."""

    lock: Lock = field(default_factory=Lock)
    objects: tuple[Path, ...] = ()


class SharedObjects:
    """The objects of an export's sources, for checks that run in parallel."""

    def __init__(self, model: Sources) -> None:
        self._model = model
        self._lock = Lock()
        self._builds: dict[tuple[str, ...], _Build] = {}

    def of(self, tool: Tool, flags: Sequence[str], folder: Path) -> tuple[Path, ...]:
        """The objects, compiled into the folder of the first caller. Raises ToolFailedError."""
        with self._lock:
            build = self._builds.setdefault((tool.command, *flags), _Build())
        # whoever asks second waits for the first instead of compiling as well
        with build.lock:
            if not build.objects:
                sources = self._model.sources
                command = [tool.command, *STANDARD, *flags, *includes(self._model), "-c", *sources]
                # a check builds at several levels in one folder, and names its objects alike
                place = Path(mkdtemp(prefix="objects-", dir=folder))
                run_tool(command, place)
                build.objects = tuple(place / f"{path.stem}.o" for path in sources)
        return build.objects

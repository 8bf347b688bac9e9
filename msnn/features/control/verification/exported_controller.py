"""Reads the folder of an exported controller: its parts, and the limits that always hold."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msnn.verification.exported_c import UNREADABLE, CFolder, described, plain_hash, plain_name


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownLimits:
    """The constant limits of a control, which always hold; None if there is none or it is not
    known.
    """

    low: float | None
    high: float | None
    moves: bool
    """Whether there may be limits that follow references, which nothing is known of."""
    rate: float | None
    before: int | None
    """Where the state has its value of the sample before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerPart:
    """The description of an exported controller: C prefix, sizes of its structs, iterations,
    tolerance and limits of controls.
    """

    prefix: str
    inputs: int
    """Numbers in the struct of its input."""
    states: int
    iterations: int
    """Most of a solve."""
    tolerance: float
    limits: tuple[KnownLimits, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterPart:
    """The description of an exported Kalman filter or moving-horizon estimator."""

    prefix: str
    is_window: bool
    """Whether it is that of a window, which solves."""
    iterations: int
    """Most of a correction; 0 where none is needed."""
    tolerance: float
    """Of a window; 0 of a filter."""
    inputs: int
    """Numbers in the struct of inputs; there is none where it is 0."""
    measured: int
    estimated: int
    states: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedController(CFolder):
    """The folder of an export to the target `mpc`: a controller, an estimator, or both."""

    identities: Mapping[str, str]
    """The hashes of its parts, as their descriptions have them, by a pattern of their files."""
    dtype: str
    controller: ControllerPart | None
    filter: FilterPart | None

    @property
    def prefix(self) -> str:
        part = self.controller or self.filter
        assert part is not None
        return part.prefix

    @property
    def calibration(self) -> None:
        """Always None: its parameters are constants in the code."""

    @property
    def real(self) -> str:
        """The floating-point type of its C code."""
        return "float" if self.dtype == "float32" else "double"

    @property
    def has_bits(self) -> bool:
        """Whether its self-tests know the bits that every build gives."""
        tests = [path for path in self.sources if path not in self.model_sources]
        # without a compiler at export no bits are recorded (decision 0268)
        return all("golden" in path.read_text(encoding="utf-8") for path in tests)


KINDS = ("mpc", "ekf", "mhe")
"""Ends of the names of its parts."""


def read_exported_controller(folder: Path) -> ExportedController | None:
    """The export in a folder; None if there is none, or if its description is damaged."""
    try:
        parts = {kind: _about(folder, kind) for kind in KINDS}
        found = [about for about in parts.values() if about is not None]
        estimator = parts["ekf"] or parts["mhe"]
        if not found:
            return None
        return ExportedController(
            folder=folder.resolve(),
            identities={
                f"{plain_name(about['prefix'])}*.[chj]*": plain_hash(about["export_sha256"])
                for about in found
            },
            dtype=found[0]["dtype"],
            controller=None if parts["mpc"] is None else _controller(parts["mpc"]),
            filter=None if estimator is None else _filter(estimator),
        )
    except UNREADABLE:
        return None


def damaged_part(folder: Path) -> str | None:
    """The name of the first description of a controller or estimator in a folder that is damaged or
    missing; None if all are fine.
    """
    for kind in KINDS:
        try:
            about = _about(folder, kind)
            if about is not None:
                (_controller if kind == "mpc" else _filter)(about)
                plain_hash(about["export_sha256"])
        except UNREADABLE:
            return sorted(folder.glob(f"*_{kind}.json"))[0].name
        for header in sorted((folder / "include").glob(f"*_{kind}.h")) if about is None else ():
            return f"{header.stem}.json"
    return None


def _about(folder: Path, kind: str) -> dict[str, Any] | None:
    # a folder has one of each kind
    for path in sorted(folder.glob(f"*_{kind}.json")):
        about: dict[str, Any] = described(path)
        # from a file that anybody may have written: it names types and functions of C
        if about["dtype"] not in ("float32", "float64"):
            raise ValueError(about["dtype"])
        return about
    return None


def _most_iterations(about: dict[str, Any]) -> int:
    """The maximum number of iterations of a solve, with those of a second start; 0 if the
    description has none.
    """
    # exports before decision 0425 do not say it, and have none
    return int(about.get("iterations", 0)) * (2 if about.get("starts_again") else 1)


def _controller(about: dict[str, Any]) -> ControllerPart:
    return ControllerPart(
        prefix=plain_name(about["prefix"]),
        inputs=_numbers(about["in"]),
        states=sum(int(state["size"]) for state in about["states"]),
        iterations=_most_iterations(about),
        tolerance=float(about["tolerance"]),
        limits=tuple(
            KnownLimits(
                low=_number(limit["min"]),
                high=_number(limit["max"]),
                # exports before decision 0388 do not say it: less is then asked of them
                moves=bool(limit.get("moves", True)),
                rate=_number(limit.get("rate")),
                before=None if limit.get("before") is None else int(limit["before"]),
            )
            for limit in about["limits"]
        ),
    )


def _filter(about: dict[str, Any]) -> FilterPart:
    return FilterPart(
        prefix=plain_name(about["prefix"]),
        is_window="horizon" in about,
        iterations=_most_iterations(about),
        tolerance=float(about.get("tolerance", 0)),
        inputs=_numbers(about["in"]),
        measured=_numbers(about["measured"]),
        estimated=sum(int(part["size"]) for part in about["estimated"]),
        states=int(about["states"]),
    )


def _numbers(fields: list[dict[str, Any]]) -> int:
    return sum(math.prod(field["shape"]) for field in fields)


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)

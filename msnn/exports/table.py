"""Lists the export targets, one line each, so that help texts need not import them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from msnn.packages import CASADI, FMPY, ONNX, ONNXRUNTIME, TORCH, OptionalPackage
from spec_schema import registry
from spec_schema.fields.entry import LateObject
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import look_up


@dataclass(frozen=True, slots=True)
class ListedTarget:
    """A target of exports, with the properties that are known without importing its module."""

    name: str
    """Name on the command line, in `export:`, and of its folder."""
    title: str
    about: str
    sections: tuple[str, ...] = ()
    """The spec must have one of these sections; () means any spec."""
    extras: tuple[str, ...] = ()
    """Extras for `--with` and the spec's `with:`."""
    writer: OptionalPackage | None = None
    """Package required for writing."""
    runner: OptionalPackage | None = None
    """Additional package required for running."""

    place: LateObject | None = None
    """Location of its record if a feature provides it; else `msnn/exports/targets/<name>.py`."""

    plugin: registry.TargetLine | None = None
    """The line of a plug-in that brings it."""

    def load(self) -> Any:
        """The record of the target, imported with its backend."""
        if self.plugin is not None:
            from msnn.exports.plugin_target import plugin_target

            return plugin_target(self.plugin)
        own = LateObject(f"msnn.exports.targets.{self.name}", "TARGET")
        return (self.place or own).value

    def suits(self, sections: Collection[str]) -> bool:
        """True if the target applies to a spec with these sections."""
        return not self.sections or not set(self.sections).isdisjoint(sections)

    @property
    def can_be_written(self) -> bool:
        """True if all packages for writing are installed."""
        return self.writer is None or self.writer.is_installed

    @property
    def left_out(self) -> str:
        """The message that it is omitted, with the install command."""
        assert self.writer is not None
        missing = f"{self.writer.name} is not installed; {self.writer.install}"
        return f"{self.name} is left out: {missing}"

    def require_writer(self) -> None:
        """Raises MissingExtraError if the package for writing is not installed."""
        if self.writer is not None:
            self.writer.require(f"writes {self.title} exports")

    def require_runner(self) -> None:
        """Raises MissingExtraError if the package for running is not installed."""
        if self.runner is not None:
            self.runner.require(f"runs {self.title} models")


def _of_feature(line: registry.TargetLine) -> ListedTarget:
    return ListedTarget(
        line.key,
        line.title,
        line.help,
        sections=line.sections,
        extras=line.extras,
        place=line.target,
        plugin=line if line in registry.TARGETS.of_plugins else None,
    )


TARGETS = (
    ListedTarget("torch", "torch", "a module that needs only torch", writer=TORCH),
    ListedTarget(
        "onnx",
        "ONNX",
        "models with explicit states",
        writer=ONNX,
        runner=ONNXRUNTIME,
    ),
    ListedTarget("casadi", "CasADi", "functions with named ports", writer=CASADI),
    ListedTarget(
        "c",
        "C",
        "C99 in floating or fixed point, with a self-test",
        extras=("jacobian", "state_jacobian", "parameter_jacobian", "ros2"),
    ),
    ListedTarget(
        "fmu",
        "FMU",
        "units for co-simulation by FMI 2.0 and 3.0",
        runner=FMPY,
    ),
    *(_of_feature(line) for line in registry.TARGETS.ours),
)
"""The targets of msnn; those of plug-ins are written when somebody names them."""
NAMES = tuple(target.name for target in TARGETS)
EXTRAS = tuple(extra for target in TARGETS for extra in target.extras)
"""Extras in the order in which they are written."""


def listed(name: str) -> ListedTarget:
    """The target with this name."""
    return next(target for target in every_target() if target.name == name)


def every_target() -> tuple[ListedTarget, ...]:
    """The targets of msnn, then those of the plug-ins that were looked up."""
    return (*TARGETS, *map(_of_feature, registry.TARGETS.of_plugins))


def names_for(asked: Collection[str]) -> tuple[str, ...]:
    """The names of all targets; looks plug-ins up if one of the names is not a target of msnn."""
    if not {*NAMES, "all"}.issuperset(asked):
        look_up()
    return tuple(target.name for target in every_target())

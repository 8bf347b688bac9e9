"""Combines all changes between two models, and decides which of them fail a pipeline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.features.changes.export_changes import export_changes
from msnn.features.changes.interface_changes import InterfaceChange, interface_changes
from msnn.features.changes.metric_changes import MetricChange, metric_changes
from msnn.model.model import Model
from msnn.model.needed_plugins import recorded_plugins
from msnn.model.saved_run import DESCRIPTION, read_json
from msnn.reports.compare_specs import SpecDifference, compare_specs
from msnn.validation.validate import ValidationReport
from spec_schema.diagnostics.diagnostic import Diagnostic

FailOn = Literal["any", "breaking", "worse", "never"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedNumber:
    """A scalar that both runs have learned."""

    name: str
    unit: str
    old: float
    new: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PluginChange:
    """A plug-in whose version differs; None for a model that does not use it."""

    package: str
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """A run: its weights and their accuracy; None if data cannot be read."""

    weights: Mapping[str, FloatArray]
    validation: ValidationReport | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelChanges:
    """The changes between two models; metrics and parameters only between two runs."""

    name: str
    specs: SpecDifference
    interface: tuple[InterfaceChange, ...]
    metrics: tuple[MetricChange, ...] = ()
    learned: tuple[LearnedNumber, ...] = ()
    plugins: tuple[PluginChange, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()

    @property
    def breaking(self) -> tuple[InterfaceChange, ...]:
        """The changes that break users of the model."""
        return tuple(change for change in self.interface if change.breaks)

    def worse(self, margin: float) -> tuple[MetricChange, ...]:
        """Metrics whose error grew by more than this fraction."""
        return tuple(c for c in self.metrics if c.growth is not None and c.growth > margin)


def model_changes(
    old: Model,
    new: Model,
    runs: tuple[Trained, Trained] | None = None,
    warnings: tuple[Diagnostic, ...] = (),
) -> ModelChanges:
    """Compares two models, and with `runs` also their trained weights and metrics."""
    metrics: tuple[MetricChange, ...] = ()
    learned: tuple[LearnedNumber, ...] = ()
    if runs is not None:
        before, after = runs
        learned = _learned(new.program, before.weights, after.weights)
        # one of them alone would call every metric new
        if before.validation is not None and after.validation is not None:
            metrics = metric_changes(before.validation, after.validation)
    return ModelChanges(
        name=new.name,
        specs=compare_specs(old, new),
        interface=(*interface_changes(old.program, new.program), *export_changes(old, new)),
        metrics=metrics,
        learned=learned,
        plugins=_plugin_changes(_plugins_of(old), _plugins_of(new)),
        warnings=warnings,
    )


def _plugins_of(model: Model) -> dict[str, str]:
    """The plug-ins of a model with their versions: of a run those that it was trained with."""
    if model.run is not None:
        return recorded_plugins(read_json(model.run / DESCRIPTION))
    return {plugin.package: plugin.version for plugin in model.program.plugins}


def _plugin_changes(old: Mapping[str, str], new: Mapping[str, str]) -> tuple[PluginChange, ...]:
    return tuple(
        PluginChange(package=package, old=old.get(package), new=new.get(package))
        for package in sorted({*old, *new})
        if old.get(package) != new.get(package)
    )


def _learned(
    program: Program, old: Mapping[str, FloatArray], new: Mapping[str, FloatArray]
) -> tuple[LearnedNumber, ...]:
    return tuple(
        LearnedNumber(
            name=parameter.name,
            unit="" if parameter.unit is None else parameter.unit.text,
            old=float(old[parameter.name].item()),
            new=float(new[parameter.name].item()),
        )
        for parameter in program.parameters
        # arrays have pictures and reports; a table of thousands of numbers says nothing
        if parameter.learn and not parameter.axes
        # the old model may have had an array of this name
        if parameter.name in old and old[parameter.name].size == 1
    )

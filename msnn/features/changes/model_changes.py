"""Combines all changes between two models, and decides which of them fail a pipeline."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.data.formats.table_of_formats import format_plugins
from msnn.data.reading.files import matching
from msnn.features.changes.interface_changes import (
    InterfaceChange,
    export_changes,
    interface_changes,
)
from msnn.model.model import Model
from msnn.model.saved_run import DESCRIPTION, data_plugins, read_json, recorded_plugins
from msnn.reports.compare_specs import SpecDifference, compare_specs
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import MetricRow, ValidationReport
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors.plugins import OTHER_VERSION

_BEST = {"fit": 100.0, "r2": 1.0}
"""Best values of metrics that increase with accuracy; the error is the distance from them."""
_UNJUDGED = ("aic",)
"""Metrics without a meaningful ratio: `aic` includes the number of parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """The value of one metric in both models. `old` or `new` is None if that model does not measure
    it.
    """

    of: str
    metric: str
    unit: str
    rollout: str
    data: str
    old: float | None
    new: float | None
    growth: float | None
    """Relative increase of the error, 0.1 for a tenth; None if undefined."""
    note: str
    """The reason for an undefined increase, or further differences."""
    span: Span | None
    """Place of the entry in the new spec."""


def metric_changes(old: ValidationReport, new: ValidationReport) -> tuple[MetricChange, ...]:
    """A change for every metric of either report. Metrics of the new report come first, in its
    order, then those of the old one only.
    """
    before, after = _by_meaning(old), _by_meaning(new)
    return tuple(
        # the new one's order, then what only the old one measures
        _change(before.get(meaning), after.get(meaning))
        for meaning in {**after, **before}
    )


def error_growth(metric: str, old: float, new: float) -> float | None:
    """The relative increase of the error of a metric, (new − old)/old; 0.1 is a tenth more.

    For rmse, mae, max_abs, fvu and losses the error is the value; for `fit` and `r2` it is the
    distance from 100 % and 1. NaN counts as an infinite error. From an error of 0 the increase is
    ±inf, from an infinite one ±1, without a change 0. None for `aic`, which has no meaningful
    ratio.
    """
    if metric in _UNJUDGED:
        return None
    best = _BEST.get(metric)
    errors = (old, new) if best is None else (best - old, best - new)
    before, after = (math.inf if math.isnan(error) else error for error in errors)
    if before == after:
        return 0.0
    if before == 0.0 or math.isinf(before):  # no share of it is a number
        return math.copysign(1.0 if before else math.inf, after - before)
    return (after - before) / abs(before)


def _by_meaning(report: ValidationReport) -> dict[tuple[str, ...], MetricRow]:
    return {(row.of, row.metric, rollout_text(row), row.data): row for row in report.rows}


def _change(old: MetricRow | None, new: MetricRow | None) -> MetricChange:
    row = new or old
    assert row is not None
    growth, note = None, ""
    if old is None or new is None:
        note = "only in the new spec" if old is None else "only in the old spec"
    # not converted: a unit of a target that changed may be a mistake
    elif old.unit != new.unit:
        note = f"in {unit_text(old.unit) or '1'} before"
    else:
        growth = error_growth(new.metric, old.value, new.value)
        note = "" if old.scored == new.scored else f"{old.scored} values before, {new.scored} now"
    return MetricChange(
        of=row.of,
        metric=row.metric,
        unit=unit_text(row.unit),
        rollout=rollout_text(row),
        data=row.data,
        old=None if old is None else old.value,
        new=None if new is None else new.value,
        growth=growth,
        note=note,
        span=None if new is None else new.span,
    )


FailOn = Literal["any", "breaking", "worse", "never"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedNumber:
    """A scalar parameter, with the values that both runs have learned."""

    name: str
    unit: str
    old: float
    new: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PluginChange:
    """A plug-in whose version differs between the models; None if a model does not use it."""

    package: str
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """The weights of a run, and its metrics; `validation` is None if its data cannot be read."""

    weights: Mapping[str, FloatArray]
    validation: ValidationReport | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelChanges:
    """The changes between two models. `metrics` and `learned` are empty unless both are runs;
    `name` is that of the new model.
    """

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
        """Metrics whose error grew by more than `margin`, a fraction such as 0.05 for 5 %."""
        return tuple(c for c in self.metrics if c.growth is not None and c.growth > margin)


def model_changes(
    old: Model,
    new: Model,
    runs: tuple[Trained, Trained] | None = None,
    warnings: tuple[Diagnostic, ...] = (),
) -> ModelChanges:
    """Compares two models, and with `runs`, the old and the new one, also their trained weights and
    metrics. `warnings` are added to those about other versions of msnn.
    """
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
        warnings=(
            *(w for m in (old, new) for w in m.warnings if w.code == OTHER_VERSION),
            *warnings,
        ),
    )


def _plugins_of(model: Model) -> dict[str, str]:
    """The versions of the plug-ins of a model by package. For a run they are those with which it
    was trained; for a spec those that the program and its data files use now.
    """
    if model.run is not None:
        record = read_json(model.run / DESCRIPTION)
        return {**recorded_plugins(record), **data_plugins(record)}
    data = model.spec.data
    patterns = [] if data is None else [p.value for s in data.source.values() for p in s.files]
    files = [file for pattern in patterns for file in matching(model.folder, pattern) or [pattern]]
    used = (*model.program.plugins, *format_plugins(files).values())
    return {plugin.package: plugin.version for plugin in used}


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

"""Samples the functions that a model has learned: filter taps, and curves of one or two variables.

A layer is drawn with the arguments of its call in the spec, an equation as a function of its inputs
and states. Each is compiled as a small separate model, and evaluated over the range of the data.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.nodes import extents
from compiler.ir.program import Program
from compiler.ir.types import WINDOW
from msnn.data.dataset import Dataset, FloatArray
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.reports.drawn import MOST_ELEMENTS, element_name, unit_of, with_unit
from msnn.simulation.simulate import simulate
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.spec_data import spec_data
from spec_schema.expressions.tree import Call, Expression, Name, expression_text
from spec_schema.reading.settings import workflow
from spec_schema.sections.references import calls_in, names_in
from spec_schema.sections.spec import Spec
from spec_schema.yaml_tree.writer import yaml_text

_POINTS = 241
_STEPS = 300
"""Steps per recording, from which the ranges of arguments are determined."""
MOST_FUNCTIONS = 16
"""Maximum number of functions in a plot or a page."""
_MOST_CURVES = 8
_DYNAMICS = ("inputs", "targets", "states", "outputs", "integrator", "doc")
_DRAWN_LAYERS = ("fuzzify", "interpolation", "mlp", "equation_learner")

Weights = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One curve of a function."""

    label: str
    y: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedFunction:
    """A sampled function: all curves over the same x."""

    title: str
    x: FloatArray
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    is_taps: bool = False
    """True if x are samples of a filter, drawn as stems."""
    left_out: int = 0
    """Number of omitted curves."""

    def titled(self, drawn: int) -> str:
        """Its title, with the number of missing curves if only `drawn` are shown."""
        missing = self.left_out + len(self.curves) - min(drawn, len(self.curves))
        curves = "curve" if missing == 1 else "curves"
        return f"{self.title} ({missing} {curves} not drawn)" if missing else self.title


@dataclass(frozen=True, slots=True)
class _Candidate:
    """An expression to draw as a function of its arguments."""

    title: str
    expression: str
    """The expression with the arguments `a0`, `a1`."""
    arguments: tuple[str, ...]
    needs: frozenset[str]
    renamed: tuple[str, ...]
    """Names of the arguments in the expression."""


@dataclass(frozen=True, slots=True)
class _Argument:
    low: float
    high: float
    unit: str


def learned_functions(
    model: Model, weights: Weights, data: Dataset | None
) -> tuple[LearnedFunction, ...]:
    """Taps of every filter; without sub-models also curves over the data's range."""
    found = list(_taps(model.program, weights))
    # a part of a linked model cannot be cut out: what connects its inputs stands in other files
    if data is not None and not model.read.used:
        candidates = [*_layers(model.spec), *_equations(model.spec, model.program)]
        found += _curves(model, weights, data, candidates)
    return tuple(found)


def _taps(program: Program, weights: Weights) -> Iterator[LearnedFunction]:
    for parameter in program.parameters:
        # the window is the last axis of whatever has one (R3)
        if not parameter.axes or parameter.axes[-1].name != WINDOW or not parameter.learn:
            continue
        count = parameter.axes[-1].size
        if count < 2:
            continue
        rows = weights[parameter.name].reshape(-1, count)
        shapes = [axis.size for axis in parameter.axes[:-1]]
        names = [element_name("", index) or "taps" for index in np.ndindex(*shapes)]
        yield LearnedFunction(
            title=f"{parameter.name}: {count} taps",
            x=np.arange(1 - count, 1, dtype=np.float64),
            x_label="sample, counted from t",
            y_label="weight",
            curves=tuple(
                Curve(label=name, y=row)
                for name, row in list(zip(names, rows, strict=True))[:MOST_ELEMENTS]
            ),
            is_taps=True,
            left_out=max(len(names) - MOST_ELEMENTS, 0),
        )


def _layers(spec: Spec) -> Iterator[_Candidate]:
    """Memoryless layers with one or two arguments, with those of their first call."""
    calls: dict[str, Call] = {}
    for call in calls_in((spec.equations, spec.outputs, spec.states, spec.layers)):
        if isinstance(call.function, Name):
            # a layer that is called twice has one curve, over what it is called with first
            calls.setdefault(call.function.name, call)
    for name, layer in spec.layers.items():
        if name not in calls or not any(getattr(layer, kind) for kind in _DRAWN_LAYERS):
            continue
        if layer.fuzzify is not None and layer.fuzzify.over:
            continue
        call = calls[name]
        texts = [expression_text(argument) for argument in call.arguments]
        if len(texts) in (1, 2) and not call.keywords:
            own = tuple(f"a{number}" for number in range(len(texts)))
            yield _Candidate(
                title=f"{name}({', '.join(texts)})",
                expression=f"{name}({', '.join(own)})",
                arguments=tuple(texts),
                needs=frozenset(_needed(spec, [name])),
                renamed=own,
            )


def _equations(spec: Spec, program: Program) -> Iterator[_Candidate]:
    """Equations with learned parameters that depend on one or two inputs or states."""
    learned = {p.name.partition(".")[0] for p in program.parameters if p.learn}
    for name, equation in spec.equations.items():
        needs = _needed(spec, names_in(equation.expr))
        leaves = tuple(n for n in (*spec.inputs, *spec.states, *spec.targets) if n in needs)
        if len(leaves) in (1, 2) and needs & learned and not _is_layer_call(equation.expr, spec):
            yield _Candidate(
                title=f"{name}({', '.join(leaves)})",
                expression=expression_text(equation.expr),
                arguments=leaves,
                needs=frozenset(needs),
                renamed=leaves,
            )


def _is_layer_call(expression: Expression, spec: Spec) -> bool:
    """True if the expression is only a call of a layer, which is drawn as a layer."""
    return (
        isinstance(expression, Call)
        and isinstance(expression.function, Name)
        and expression.function.name in spec.layers
    )


def _needed(spec: Spec, names: Iterator[str] | Sequence[str]) -> set[str]:
    """All dependencies of the names, down to inputs, states and parameters."""
    waiting, found = list(names), set[str]()
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        for section in (spec.layers, spec.equations, spec.functions):
            if name in section:
                waiting += names_in(cast("Any", section)[name])
    return found


def _curves(
    model: Model, weights: Weights, data: Dataset, candidates: Sequence[_Candidate]
) -> Iterator[LearnedFunction]:
    texts = list(dict.fromkeys(text for each in candidates for text in each.arguments))
    ranges = _ranges(model, weights, data, texts)
    for candidate in candidates:
        if all(text in ranges for text in candidate.arguments):
            arguments = [ranges[text] for text in candidate.arguments]
            if (found := _evaluated(model, weights, candidate, arguments)) is not None:
                yield found


def _ranges(
    model: Model, weights: Weights, data: Dataset, texts: Sequence[str]
) -> dict[str, _Argument]:
    """The ranges of scalar expressions (`texts`) in a simulation over the data, by text."""
    outputs = {f"argument{number}": {"expr": text} for number, text in enumerate(texts)}
    probe = _compiled(model, {"outputs": outputs}, (*workflow(), "losses"))
    if probe is None or not texts:
        return {}
    found: dict[str, _Argument] = {}
    kept = tuple(o for o in probe.outputs if not probe.step[o.node].type.axes)
    runs = simulate(
        # the interpreter: a kernel would be compiled for a probe that runs once
        replace(probe, outputs=kept),
        data,
        _own(probe, weights),
        _STEPS,
        engine="interpreter",
    )
    for output in kept:
        values = np.concatenate([run.outputs[output.name] for run in runs])
        values = values[np.isfinite(values)]
        if len(values) and values.min() < values.max():
            text = texts[int(output.name.removeprefix("argument"))]
            low, high = float(values.min()), float(values.max())
            found[text] = _Argument(low, high, unit_of(probe.step[output.node].type.unit))
    return found


def _evaluated(
    model: Model, weights: Weights, candidate: _Candidate, arguments: Sequence[_Argument]
) -> LearnedFunction | None:
    """The function over a grid; None if it has memory or several elements."""
    inputs: dict[str, Any] = {
        name: {"unit": argument.unit} if argument.unit else {}
        for name, argument in zip(candidate.renamed, arguments, strict=True)
    }
    changes = {"inputs": inputs, "outputs": {"drawn": {"expr": candidate.expression}}}
    program = _compiled(model, changes, (*workflow(), "losses", *_DYNAMICS), candidate.needs)
    if program is None or program.states:
        return None
    read = extents(program.step, log=False).values()
    type = program.step[program.outputs[0].node].type
    if len(type.axes) > 1 or any((extent.first, extent.last) != (0, 0) for extent in read):
        return None
    first = arguments[0]
    x = np.linspace(first.low, first.high, _POINTS)
    levels = [None] if len(arguments) == 1 else np.linspace(arguments[1].low, arguments[1].high, 5)
    interpreter = Interpreter(program, _own(program, weights))
    curves: list[Curve] = []
    for level in levels:
        log = {candidate.renamed[0]: x}
        if level is not None:
            log[candidate.renamed[1]] = np.full(_POINTS, level)
        # every point is a row of its own, evaluated beside all others
        values = interpreter.step(log, np.arange(_POINTS), {}, losses=False).outputs["drawn"]
        y = np.broadcast_to(values, (_POINTS, *values.shape[1:])).reshape(_POINTS, -1)
        for number in range(y.shape[1]):
            element = element_name("", (number,)) if type.axes else ""
            at = "" if level is None else f"{candidate.arguments[1]} = {level:.4g}"
            label = " ".join(filter(None, (element, at, arguments[-1].unit if at else "")))
            curves.append(Curve(label=label or candidate.title, y=y[:, number]))
    return LearnedFunction(
        title=candidate.title,
        x=x,
        x_label=with_unit(candidate.arguments[0], first.unit),
        y_label=with_unit(candidate.title.partition("(")[0], unit_of(type.unit)),
        curves=tuple(curves[:_MOST_CURVES]),
        left_out=max(len(curves) - _MOST_CURVES, 0),
    )


def _compiled(
    model: Model,
    changes: Mapping[str, Any],
    without: Sequence[str],
    needs: frozenset[str] | None = None,
) -> Program | None:
    """Compiles the model's spec with changed sections; None if that fails.

    `without` are sections to remove, `needs` the names that must remain.
    """
    data = {key: value for key, value in spec_data(model.spec).items() if key not in without}
    # only what the function needs: other entries read inputs that the small model has not
    if needs is not None:
        for section in ("layers", "equations", "functions"):
            data[section] = {n: each for n, each in data.get(section, {}).items() if n in needs}
        data = {key: value for key, value in data.items() if value != {}}
    try:
        # through text and the reader: the small model is checked as every spec is
        return load_model(model.path, text=yaml_text({**data, **changes})).program
    except SpecError:  # an argument that is a window, a name that only the whole model has
        return None


def _own(program: Program, weights: Weights) -> dict[str, FloatArray]:
    """The weights of the parameters that `program`, a part of the model, has."""
    return {p.name: weights[p.name] for p in program.parameters if p.name in weights}

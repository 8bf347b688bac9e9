"""Selects the rows of a recording that satisfy the `filter:` of the spec."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiler.elaboration.compile import compile_linked
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program, Signal
from compiler.linking.link import Linked
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import reads
from msnn.errors.data import rows as errors
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.tree import Call, Compare, Expression, Name, Number
from spec_schema.sections.data import Data
from spec_schema.sections.signals import Loss
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Freeze

_NAME = "filter"
_AT_ONCE = 1 << 16


@dataclass(frozen=True, slots=True)
class RowFilter:
    """A condition on the signals of one row: a model with one loss, 1 if it is true, else 0.

    It is a loss because only losses may read targets.
    """

    program: Program
    span: Span

    @property
    def signals(self) -> tuple[Signal, ...]:
        return self.program.signals

    @property
    def read(self) -> tuple[str, ...]:
        """The signals that the condition reads."""
        return tuple(reads(self.program.step, [self.program.losses[0].prediction]))

    def kept(self, series: Mapping[str, FloatArray], rows: int) -> BoolArray:
        """Mask of rows that satisfy the condition; a missing value makes it false."""
        judge = Interpreter(self.program)
        kept = np.zeros(rows, dtype=np.bool_)
        # in parts: the interpreter holds an array for each operation
        for first in range(0, rows, _AT_ONCE):
            t = np.arange(first, min(first + _AT_ONCE, rows))
            prediction, _ = judge.step(series, t, judge.start(series, t)).losses[_NAME]
            # `where` gives 1 or 0 exactly, and `l1` of a single number is that number
            kept[t] = prediction > 0
        return kept


def row_filters(spec: Spec) -> dict[str, RowFilter]:
    """The row filter of every data source with a `filter:`, including the default one.

    The spec must have the entries of sub-models under their full names. Raises SpecError with all
    errors in the filters.
    """
    data = spec.data
    if data is None:
        return {}
    findings = Findings()
    found: dict[str, RowFilter] = {}
    for name, source in data.source.items():
        condition = source.filter or data.filter
        if condition is not None and (filter := _compiled(spec, condition, data, findings)):
            found[name] = filter
    findings.raise_errors()
    return found


def _compiled(
    spec: Spec, condition: Expression, data: Data, findings: Findings
) -> RowFilter | None:
    if not isinstance(condition, Compare):
        findings.report(errors.not_a_condition(condition.span))
        return None
    span = condition.span
    numbers = (Number(1.0, span), Number(0.0, span))
    held = Call(Name("where", span), (condition, *numbers), (), span)
    # not validated again: every part comes out of a spec that was
    loss = Loss.model_construct(expr=Call(Name("l1", span), (held,), (), span), place=data.place)
    alone = Spec.model_construct(
        msnn=1,
        name=spec.name,
        sample_time=spec.sample_time,
        dims=spec.dims,
        # a filter learns nothing of a sub-model
        use={name: use.model_copy(update={"freeze": Freeze()}) for name, use in spec.use.items()},
        inputs=spec.inputs,
        targets=spec.targets,
        constants=spec.constants,
        functions=spec.functions,
        outputs={},
        losses={_NAME: loss},
        place=spec.place,
    )
    try:
        program = compile_linked(Linked(alone, {})).program
    except SpecError as error:
        findings.report(*error.diagnostics)
        return None
    around = reads(program.step, [program.losses[0].prediction]).values()
    # a filter decides row by row, before it is known which rows follow each other
    if program.states or any((extent.first, extent.last) != (0, 0) for extent in around):
        findings.report(errors.wide_filter(span))
        return None
    return RowFilter(program, span)

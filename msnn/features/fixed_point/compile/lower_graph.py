"""Lowers one graph to integer nodes, element by element."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.operations import NOWHERE, evaluator
from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId
from compiler.passes.analyses.compact_sets import CompactSets, compact_sets
from msnn.features.fixed_point.compile.elementwise import ElementwiseForms
from msnn.features.fixed_point.compile.polynomials import PolynomialForm
from msnn.features.fixed_point.compile.settle import Ramp, Settler
from msnn.features.fixed_point.compile.thresholds import Decided, IntegerCondition
from msnn.features.fixed_point.integers.builder import CannotFitError
from msnn.features.fixed_point.integers.program import Width
from spec_schema.diagnostics.source import Span

Elements = NDArray[np.object_]
"""Forms or conditions in the shape of a node, after an axis of length 1."""

_LONGEST = 4
"""Maximum number of terms of a sum that stays unrounded, as it may become part of another sum."""


class UnsupportedError(Exception):
    """A value that fixed point cannot represent: its name in messages (`what`), its place in the
    spec and the reason.
    """

    def __init__(self, what: str, span: Span | None, why: str) -> None:
        super().__init__(why)
        self.what, self.span, self.why = what, span, why


class Lowering(ElementwiseForms):
    """Lowers one graph: computes the forms of its nodes, element by element. `reads` gives the
    forms of a node that reads signals, `states` those of a state by name.
    """

    def __init__(
        self,
        graph: Graph,
        width: Width,
        reads: Callable[[Lowering, Node], Elements],
        states: Callable[[Lowering, str], Elements],
    ) -> None:
        super().__init__(width)
        self.graph = graph
        self._reads, self._states = reads, states
        # found before elements are: of single elements nobody could tell that they sum to 1
        self._sets = compact_sets(graph)
        self._values: dict[NodeId, Elements] = {}

    def value(self, index: NodeId) -> Elements:
        """The elements of a node as forms or conditions; operands are computed first. Raises
        UnsupportedError.
        """
        # a stack of its own: a chain of thousands of equations would be too deep for recursion
        pending = [index]
        while pending:
            current = pending[-1]
            args = self._operands(current)
            missing = [arg for arg in args if arg not in self._values]
            if current in self._values or not missing:
                # a node that two others were missing is on the stack twice
                if current not in self._values:
                    self._values[current] = self._lowered(current)
                pending.pop()
            else:
                pending += missing
        return self._values[index]

    def nodes(self, index: NodeId) -> list[int]:
        """The integer nodes of the elements of a node, in C order. Raises UnsupportedError."""
        with_place = self.graph[index]
        try:
            return [self.node(form) for form in self.value(index).ravel()]
        except CannotFitError as error:
            raise _unsupported(with_place, str(error)) from None

    def _operands(self, index: NodeId) -> tuple[NodeId, ...]:
        sets = self._sets.get(index)
        if sets is not None and self._as_ramps(sets):
            # the points of ramps are numbers of the program, no operand
            return (sets.value,)
        return self.graph[index].args

    def _as_ramps(self, sets: CompactSets) -> bool:
        if sets.shape != "triangular":
            return False
        return isinstance(self.graph[sets.points].op, ops.Constant)

    def _lowered(self, index: NodeId) -> Elements:
        node, sets = self.graph[index], self._sets.get(index)
        self.builder.span = node.span
        try:
            if sets is not None and self._as_ramps(sets):
                return self._hats(index, sets)
            found = self._evaluated(node)
        except CannotFitError as error:
            raise _unsupported(node, str(error)) from None
        except ArithmeticError:
            raise _unsupported(node, "is not finite") from None
        return found

    def _evaluated(self, node: Node) -> Elements:
        values = [self._values[arg] for arg in node.args]
        match node.op:
            case ops.Constant(numbers):
                forms = [self.number(value) for value in numbers]
                return _elements(forms, node.type.shape)
            case ops.ReadSamples():
                return self._reads(self, node)
            case ops.ReadState(name):
                return self._states(self, name)
            case ops.ReadTraining():
                raise AssertionError("no program reads values of training")
            case ops.Window(name):
                before, newest = self._states(self, name), values[0]
                return np.concatenate([before, newest[..., np.newaxis]], -1)
            # x·x of one word is never negative, which x·y of two equal ones is not known to be
            case ops.Multiply() if values[0] is values[1]:
                return _each(_square, values[0])
            case ops.Add() | ops.Subtract() | ops.Multiply() | ops.Negate() | ops.Reduction():
                # linear operations only gather terms; a node is made once a form has grown too long
                return _each(self.shortened, self._by_numpy(node))
            case ops.Identity() | ops.Structure():
                return self._by_numpy(node)
            case ops.Divide():
                return _each(self.quotient, *values)
            case ops.Minimum():
                return _each(self.lesser, *values)
            case ops.Maximum():
                return _each(self.greater, *values)
            case ops.Clamp():
                # min after max, as C does: where the limits cross, the upper one wins
                return _each(self.lesser, _each(self.greater, *values[:2]), values[2])
            case ops.Compare(relation):
                found = _each(partial(self.condition, relation), *values)
                return _each(_sure, found) if self._is_clamped_above(node) else found
            case ops.Select():
                return _each(self.selected, *values)
            case ops.Apply(function):
                return _each(partial(self.applied, function), *values)
            case ops.ReadParameter(name):
                raise AssertionError(f"parameter {name} is a constant by now")
            case _:
                assert_never(node.op)

    def _is_clamped_above(self, node: Node) -> bool:
        """True if a comparison node is `clamp(x, low, …) >= low`, which fails only for NaN."""
        clamped, low = node.args
        if node.op != ops.Compare(ops.Relation.GREATER_EQUAL):
            return False
        return isinstance(self.graph[clamped].op, ops.Clamp) and self.graph[clamped].args[1] == low

    def _by_numpy(self, node: Node) -> Elements:
        types = tuple(self.graph[arg].type for arg in node.args)
        # numpy adds, multiplies and moves forms as it does numbers
        evaluate = evaluator(node, types, {}, np.dtype(np.object_))
        values: Any = self._values
        return evaluate(values, NOWHERE)

    def shortened(self, form: PolynomialForm) -> PolynomialForm:
        return self.form(self.node(form)) if len(form.terms) > _LONGEST else form

    def _hats(self, index: NodeId, sets: CompactSets) -> Elements:
        """The membership degrees of triangular sets as differences of ramps, one per set; their sum
        is exactly 1. `index` is the node that they replace.
        """
        points = self.graph[sets.points].op
        assert isinstance(points, ops.Constant), "points of ramps are numbers"
        (form,) = self._values[sets.value].ravel()
        builder = self.builder
        node = builder.as_word(self.node(form))
        fraction = builder[node].fraction
        # the centres in units of the word, so that a value at a centre is exactly there
        knots = [round(math.ldexp(point, fraction)) for point in points.values]
        ramps: list[PolynomialForm] = []
        for place, (low, high) in enumerate(pairwise(knots)):
            # rounded to the word, neighbours can meet: a ramp of no length has no slope
            if high == low:
                raise CannotFitError("has centres that are one number in this format")
            bounds = builder[node].low - low, builder[node].high - low
            # x − p in units of the word, then cut to 0 … l: the ramp that rises over this interval
            shifted = builder.weighted_sum(-low, [(1, node)], fraction, bounds)
            ramp = builder.saturated(shifted, 0, high - low)
            # a degree is clip((x − p) / l): what x, p and l are off, each at most once
            begin, end = points.values[place : place + 2]
            off = abs(math.ldexp(low, -fraction) - begin) + builder.errors[node]
            off += abs(math.ldexp(high - low, -fraction) - (end - begin))
            # the value's bounds do not reach this interval: the ramp is empty or full for good
            if builder[ramp].low == builder[ramp].high:
                degree = self.number(float(builder[ramp].low > 0))
                ramps.append(degree.within(off * math.ldexp(1.0, fraction) / (high - low)))
                continue
            builder.allow(ramp, off)
            self.ramps[ramp] = Ramp(index, place)
            ramps.append(self.form(ramp).times(math.ldexp(1.0, fraction) / (high - low)))
        # μᵢ = rampᵢ₋₁ − rampᵢ: neighbours share a ramp, so whatever the roundings the degrees sum
        # to 1
        ends = [self.number(1.0), *ramps, self.number(0.0)]
        degrees = [before - after for before, after in pairwise(ends)]
        return _elements(degrees, self.graph[index].type.shape)


def _sure(condition: IntegerCondition | Decided) -> IntegerCondition | Decided:
    return (
        condition if isinstance(condition, IntegerCondition) else replace(condition, is_sure=True)
    )


def _square(form: PolynomialForm) -> PolynomialForm:
    return form * form


def _each(function: Callable[..., Any], *values: Elements) -> Elements:
    found = np.empty(values[0].shape, np.object_)
    flat = [value.ravel() for value in values]
    for place, elements in enumerate(zip(*flat, strict=True)):
        found.flat[place] = function(*elements)
    return found


def _elements(forms: list[PolynomialForm], shape: tuple[int, ...]) -> Elements:
    # `np.array(forms)` would ask each form whether it is a sequence
    found = np.empty(len(forms), np.object_)
    found[:] = forms
    return found.reshape((1, *shape))


def elements(settler: Settler, nodes: list[int], shape: tuple[int, ...]) -> Elements:
    """Integer nodes, in C order, as an array of forms in the shape of a value, after an axis of
    length 1.
    """
    return _elements([settler.form(node) for node in nodes], shape)


def _unsupported(node: Node, why: str) -> UnsupportedError:
    what = f"`{node.label}`" if node.label else "a value"
    return UnsupportedError(what, node.span, why)

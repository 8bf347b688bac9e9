"""Compares the Jacobian of an export with the interpreter's, at singular points too."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from backends.ports.step_interface import Port, step_interface
from compiler.interpreter.bounded import Bounded, exact
from compiler.interpreter.interpreter import physical_weights
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import Graph, History, NodeId, Program, Tape
from compiler.jacobian.jacobian import JacobianInterpreter
from compiler.jacobian.jacobian import jacobian as jacobian_of
from compiler.jacobian.matrices import Jacobian, Matrix, Vector
from compiler.passes.guard_derivatives import guard_infinite_slopes, guard_untaken
from msnn.agreement.judgement import Arrays, ExportedSlopes, FloatType, Judgement
from msnn.agreement.rounding import STEP_LIMIT
from msnn.agreement.subject import NOTHING, Deviations, Subject, bits_of_each

_LIMIT = STEP_LIMIT["float64"]

_STEEP = 1e12
"""Factor over the scale of an entry beyond which a value represents an infinite derivative.

CasADi uses 1e30 instead, times other derivatives (decision 0184).
"""


def measured_slopes(
    subject: Subject, slopes: ExportedSlopes | None, judged: Judgement
) -> Deviations:
    """Compares every matrix of an export's Jacobian with the reference, at recorded and generated
    points.

    Errors are relative to the largest entry of the matrix. If all terms of a derivative cancel, its
    entries consist of rounding errors. They are then relative to s/c: c is the largest value of the
    column, and s the size of the terms of the row's value (its rounding bound over the unit
    roundoff, decision 0180). A derivative that c turns into a rounding error of s is negligible. If
    a column is 0 at all points, its entries are relative to the terms of the entries themselves.
    Bits are compared with the reference in the arithmetic of the export.
    """
    if slopes is None:
        return NOTHING
    drawn = points(subject.program, judged)
    # slopes at singular points may be infinite: that is what is looked at
    with np.errstate(all="ignore"):
        found = slopes.at(drawn.inputs, drawn.states, drawn.count)
        wanted = _matrices(subject, slopes.jacobian, drawn, "float64")
        single = _matrices(subject, slopes.jacobian, drawn, "float32")
        values, sums = _values(subject, drawn), _sums(subject, drawn)
        matrices = [matrix for matrix in slopes.jacobian.matrices if matrix.name in found]
        lost = [np.isnan(matrix).any(axis=(1, 2), keepdims=True) for matrix in wanted.values()]
        undefined = np.logical_or.reduce(lost)
        columns = {m.name: _largest(m.columns, values[m.columns.letter], drawn) for m in matrices}
        own = dict[str, NDArray[np.float64]]()
        if any((largest <= TINY).any() for largest in columns.values()):
            own = _terms_of_slopes(subject, slopes.jacobian, drawn)
        judges = {
            f"the matrix {matrix.name}": _Judge.of(
                matrix,
                wanted[matrix.name],
                columns[matrix.name],
                sums[matrix.rows.letter],
                own.get(matrix.name),
                undefined,
            )
            for matrix in matrices
        }
        named, rounded = (
            {f"the matrix {name}": arrays[name] for name in found} for arrays in (found, single)
        )
        deviations = {name: judge.error(named[name]) for name, judge in judges.items()}
        far = [m for m in matrices if not deviations[f"the matrix {m.name}"] <= _LIMIT]
        undecided = dict[str, int]()
        # both cost another run: only of matrices that are too far by the simple measure
        if far and not subject.is_exact:
            stand_ins = _matrices(subject, _guarded(subject.program), drawn, "float64")
            for matrix, bound in zip(
                far, _roundings(subject, slopes.jacobian, far, drawn), strict=True
            ):
                name = f"the matrix {matrix.name}"
                explained = _Explanation(stand_ins[matrix.name], bound)
                deviations[name] = judges[name].error(named[name], explained)
                count = explained.unbounded(named[name], judges[name].wanted)
                undecided |= {name: count} if count else {}
        return Deviations(
            deviations,
            {name: judge.error_where_finite(rounded[name]) for name, judge in judges.items()},
            bits_of_each(named, rounded) if subject.is_exact else {},
            undecided,
        )


@dataclass(frozen=True, slots=True)
class _Judge:
    """The reference values for the entries of one matrix."""

    wanted: NDArray[np.float64]
    """(points, rows, columns); NaN where nothing is compared.

    That is in rows of non-finite values, and where infinite derivatives cancel on two paths, so
    that no result is correct (decision 0184).
    """
    scale: NDArray[np.float64]
    """Scale of errors, (points, rows, columns)."""
    undefined: NDArray[np.bool_]
    """Points at which the interpreter has a NaN in any matrix, (points, 1, 1), from an infinite
    value.

    CasADi differentiates all outputs at once, and has 0 times infinity = NaN in other entries too,
    e.g. near a gaussian set of width 0.
    """

    @staticmethod
    def of(
        matrix: Matrix,
        judged: NDArray[Any],
        largest: NDArray[np.float64],
        rows: _Sums,
        own: NDArray[np.float64] | None,
        undefined: NDArray[np.bool_],
    ) -> _Judge:
        """Builds the reference for a matrix; `largest` is per column, `own` the terms of the
        entries.
        """
        count = len(judged)
        finite = np.isfinite(_flat(matrix.rows, rows.values, count))
        # where the value itself is not finite its slope means nothing
        wanted = np.where(finite[:, :, np.newaxis], judged, np.nan)
        terms = _magnitude(_flat(matrix.rows, rows.terms, count))[:, :, np.newaxis]
        natural = np.where(largest > TINY, terms / largest, 0.0 if own is None else own)
        largest_entry = _magnitude(wanted).max(initial=0.0)
        return _Judge(wanted, np.maximum(natural, largest_entry), undefined)

    def error(self, found: NDArray[Any], explanation: _Explanation | None = None) -> float:
        """The largest error; infinite if an entry is not finite where the reference is finite.

        Where the reference is infinite, a very large derivative of the same sign is accepted.
        """
        found, wanted = found.astype(np.float64), self.wanted
        # `STEEP` of the guards, times other slopes, stands for an infinite one
        steep = np.isinf(wanted) & (np.sign(wanted) * found >= _STEEP * self.scale)
        right = (found == wanted) | np.isnan(wanted) | steep | (np.isnan(found) & self.undefined)
        if explanation is not None:
            right |= explanation.of(found, wanted)
        errors = np.where(right, 0.0, np.abs(found - wanted) / self.scale)
        return float(np.where(np.isfinite(errors), errors, math.inf).max(initial=0.0))

    def error_where_finite(self, found: NDArray[Any]) -> float:
        """The largest error of finite entries."""
        return self.error(np.where(np.isfinite(found), found, self.wanted))


@dataclass(frozen=True, slots=True)
class _Explanation:
    """Accepted deviations of entries of a matrix, (points, rows, columns)."""

    stand_in: NDArray[Any]
    """The reference Jacobian of the guarded program, which replaces infinite derivatives."""
    rounding: NDArray[np.float64]
    """Maximum difference of two float64 programs that compute an entry."""

    def of(self, found: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask of entries that replace an infinite one, or are within rounding."""
        near = np.abs(found - self.stand_in) <= _LIMIT * np.abs(self.stand_in)
        finite = np.isfinite(wanted) & np.isfinite(found)
        rounded = finite & (np.abs(found - wanted) <= self.rounding)
        return np.isinf(wanted) & near | rounded

    def unbounded(self, found: NDArray[np.float64], wanted: NDArray[np.float64]) -> int:
        """Number of points with an infinite bound, which accepts any value."""
        apart = np.isinf(self.rounding) & (np.abs(found - wanted) > 0.0)
        return int(np.any(apart, axis=(1, 2)).sum())


def _guarded(program: Program) -> Jacobian:
    """The Jacobian in the form for libraries that differentiate themselves (decision 0184)."""
    return jacobian_of(guard_infinite_slopes(guard_untaken(program)), parameters=True)


def _roundings(
    subject: Subject, slopes: Jacobian, matrices: Sequence[Matrix], drawn: Points
) -> list[NDArray[np.float64]]:
    """Twice the rounding bound of each entry: for the reference and the export."""
    wanted = [node for matrix in matrices for node in matrix.nodes]
    graph, found = _bounds(subject, slopes.graph, wanted, drawn)
    spreads = {node: 2.0 * found[node].spread(graph.unit) for node in wanted}
    # an entry that is a number is the same in all programs
    blank = [replace(one, known=tuple(0.0 for _ in one.known)) for one in matrices]
    return [matrix.filled(spreads, drawn.count, np.dtype(np.float64)) for matrix in blank]


def _largest(vector: Vector, values: Arrays, drawn: Points) -> NDArray[np.float64]:
    """The largest magnitude of each element of a vector."""
    return _magnitude(_flat(vector, values, drawn.count)).max(axis=0, initial=0.0)


def _magnitude(values: NDArray[Any]) -> NDArray[np.float64]:
    """|values|, 0 for non-finite ones."""
    return np.abs(np.where(np.isfinite(values), values, 0.0))


def _flat(vector: Vector, values: Arrays, count: int) -> NDArray[np.float64]:
    """The elements of a vector at every point, (points, size)."""
    parts = [np.zeros((count, 0))]
    for member in vector.members:
        value = values[member.name].astype(np.float64)
        # what does not depend on the point is a batch of one
        parts.append(np.broadcast_to(value.reshape(-1, member.size), (count, member.size)))
    return np.concatenate(parts, axis=1)


def _values(subject: Subject, drawn: Points) -> dict[str, Arrays]:
    """The values of columns by vector, (points or 1, *shape) each."""
    weights = physical_weights(subject.program, subject.weights)
    parameters = {name: values[np.newaxis] for name, values in weights.items()}
    return {"x": drawn.states, "u": drawn.inputs, "p": parameters}


@dataclass(frozen=True, slots=True)
class _Sums:
    """Values of next states or outputs, and the size of their terms."""

    values: Arrays
    terms: Arrays


def _sums(subject: Subject, drawn: Points) -> dict[str, _Sums]:
    program = subject.program
    roots = {
        "x": {state.name: state.next for state in program.states},
        "y": {output.name: output.node for output in program.outputs},
    }
    wanted = [node for nodes in roots.values() for node in nodes.values()]
    values, terms = _bounded(subject, program.step, wanted, drawn)
    return {
        letter: _Sums(
            {name: values[node] for name, node in nodes.items()},
            {name: terms[node] for name, node in nodes.items()},
        )
        for letter, nodes in roots.items()
    }


def _terms_of_slopes(
    subject: Subject, jacobian: Jacobian, drawn: Points
) -> dict[str, NDArray[np.float64]]:
    """The size of the terms of each entry, (points, rows, columns); 0 without a bound."""
    _, terms = _bounded(subject, jacobian.graph, jacobian.roots, drawn)
    return {
        matrix.name: _magnitude(matrix.filled(terms, drawn.count, np.dtype(np.float64)))
        for matrix in jacobian.matrices
    }


def _bounded(
    subject: Subject, nodes: Graph, wanted: Sequence[NodeId], drawn: Points
) -> tuple[dict[NodeId, NDArray[Any]], dict[NodeId, NDArray[Any]]]:
    """Values of nodes at the points, and their rounding bounds over the unit roundoff."""
    graph, found = _bounds(subject, nodes, wanted, drawn)
    return (
        {node: found[node].value for node in wanted},
        {node: found[node].spread(graph.unit) / graph.unit for node in wanted},
    )


def _bounds(
    subject: Subject, nodes: Graph, wanted: Sequence[NodeId], drawn: Points
) -> tuple[BoundedGraph, list[Bounded]]:
    """Nodes at the points with rounding bounds, and the graph with its unit roundoff."""
    log, rows = log_of(subject.program, drawn.inputs, drawn.count, np.float64)
    states = {name: exact(values.astype(np.float64)) for name, values in drawn.states.items()}
    weights = physical_weights(subject.program, subject.weights)
    graph = BoundedGraph(nodes, wanted, weights, np.dtype(np.float64))
    return graph, graph.run(log, rows, states)


def _matrices(subject: Subject, jacobian: Jacobian, drawn: Points, dtype: FloatType) -> Arrays:
    log, rows = log_of(subject.program, drawn.inputs, drawn.count, dtype)
    states = {name: values.astype(dtype) for name, values in drawn.states.items()}
    own = JacobianInterpreter(jacobian, subject.program, subject.weights, dtype)
    return own.matrices(log, rows, states)


MOST_STEPS = 200
"""Maximum number of recorded steps."""
_MIXTURES = 40
TINY = 1e-9
"""A value slightly above 0."""

_Range: TypeAlias = tuple[float, float]
_Draw: TypeAlias = Callable[[NDArray[Any], _Range, bool], NDArray[Any]]
"""(recorded values, range, is input) → a value within the range."""


@dataclass(frozen=True, slots=True)
class Points:
    """Inputs and states of single steps, (points, *shape)."""

    inputs: Arrays
    states: Arrays
    count: int


def points(program: Program, judged: Judgement) -> Points:
    """The first recorded steps, then generated ones, always the same (Philox).

    Generated points are: all 0; inputs 0 and states slightly above; every range at its lower and at
    its upper limit; and mixtures. In a mixture, each quantity is one of these, random within its
    range, or a recorded value. Without a range, a quantity stays within its largest recorded
    magnitude, or within 1 if it is always 0.
    """
    # a generator whose numbers are the same on every machine and version
    random = np.random.Generator(np.random.Philox(0))
    corners: list[_Draw] = [
        # singular points are where slopes differ between tools: 0, a hair above, and ends of ranges
        lambda seen, range, is_input: np.zeros_like(seen[0]),
        lambda seen, range, is_input: np.full_like(seen[0], 0.0 if is_input else TINY),
        lambda seen, range, is_input: np.full_like(seen[0], range[0]),
        lambda seen, range, is_input: np.full_like(seen[0], range[1]),
    ]

    def mixed(seen: NDArray[Any], range: _Range, is_input: bool) -> NDArray[Any]:
        kind = int(random.integers(2 * len(corners)))
        if kind < len(corners):
            return corners[kind](seen, range, is_input)
        if kind % 2:
            low, high = range
            return random.uniform(low, high, seen.shape[1:])
        return seen[int(random.integers(len(seen)))]

    draws = [*corners, *[mixed] * _MIXTURES]
    steps = min(judged.steps, MOST_STEPS)
    ranges = _ranges(program)

    def extended(arrays: Arrays, *, are_inputs: bool) -> Arrays:
        found: dict[str, NDArray[Any]] = {}
        for name, seen in arrays.items():
            low, high = _finite(ranges[name], seen)
            # rounding may leave a drawn number outside by a digit
            drawn = [np.clip(draw(seen, (low, high), are_inputs), low, high) for draw in draws]
            # points of the record first, so that their places are those of its steps
            found[name] = np.concatenate([seen[:steps], np.array(drawn, seen.dtype)])
        return found

    return Points(
        extended(judged.inputs, are_inputs=True),
        extended(judged.states, are_inputs=False),
        steps + len(draws),
    )


def log_of(
    program: Program, inputs: Arrays, count: int, dtype: DTypeLike
) -> tuple[Mapping[str, NDArray[Any]], NDArray[np.int64]]:
    """A recording made of the inputs of all points, and the row of it at which a step reads each
    point.
    """
    ports = step_interface(program).inputs
    back = max([0, *(-port.first for port in ports)])
    span = back + max([0, *(port.last for port in ports)]) + 1
    # each point has rows of its own, as many as ports reach around
    rows = back + span * np.arange(count)
    log: dict[str, NDArray[Any]] = {}
    for port in ports:
        samples = _samples(port, inputs[port.signal.name])
        series = np.zeros((span * count, *samples.shape[2:]), dtype)
        for k in range(samples.shape[1]):
            series[rows + port.first + k] = samples[:, k]
        log[port.signal.name] = series
    return log, rows


def _samples(port: Port, values: NDArray[Any]) -> NDArray[Any]:
    """The samples of a port at each point, (points, samples, *shape of the signal), oldest
    first.
    """
    return values[:, np.newaxis] if port.type.window is None else np.moveaxis(values, -1, 1)


def _finite(range: _Range, seen: NDArray[Any]) -> _Range:
    """The range, with infinite ends replaced by the largest recorded magnitude."""
    largest = float(np.abs(np.where(np.isfinite(seen), seen, 0.0)).max(initial=0.0))
    span = largest if largest > TINY else 1.0
    low, high = range
    return (
        low if math.isfinite(low) else min(-span, high),
        high if math.isfinite(high) else max(span, low),
    )


def _ranges(program: Program) -> dict[str, _Range]:
    """The ranges of inputs and states; a delayed signal has the signal's range."""
    known = {signal.name: signal.range for signal in program.signals}
    anything = (-math.inf, math.inf)
    found = {name: range or anything for name, range in known.items()}
    for state in program.states:
        range = state.range
        match state.origin:
            case History(source):
                range = range or known.get(source)
            case Tape(signal, _):
                range = range or known.get(signal)
            case _:
                pass
        found[state.name] = range or anything
    return found

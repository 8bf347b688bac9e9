"""Recognises time integrals and derivatives, which nnodely writes as loops of relations."""

from __future__ import annotations

from collections.abc import Mapping

from msnn.features.nnodely.recognition.recognised import Followed, Recognised
from msnn.features.nnodely.saved_file.graph import Graph
from msnn.features.nnodely.terms.terms import Call, Term
from msnn.features.nnodely.terms.values import ShapeError, Value

_STEP = "SampleTime"


def calculus(graph: Graph) -> Mapping[str, Recognised]:
    """Integrals and derivatives by the relation that is their value.

    integral       I = I[t−1] + e dt, closed by itself
    trapezoidal    I = I[t−1] + (e + e[t−1]) 0.5 dt
    derivative     (e − e[t−1]) / dt, e connected to a buffer
    trapezoidal    d = (e − e[t−1]) 2 / dt − d[t−1]
    """
    found: dict[str, Recognised] = {}
    for name, given in graph.file.Inputs.items():
        source = given.closed_loop
        # `local` marks inputs that nnodely has made itself: one that a user closes is a state by
        # its own right
        if source is not None and given.connect is None and given.local:
            one = _integral(graph, name, source) or _ringing(graph, name, source)
            if one is not None:
                found[source] = one
    for name in graph.file.Relations:
        slope = _slope(graph, name)
        if slope is not None and name not in found:
            found[name] = _of_past("der", "", slope, graph)
    return found


def _integral(graph: Graph, state: str, source: str) -> Recognised | None:
    sides = graph.pair(source, "Add")
    if sides is None or not _is_own_past(graph, sides[0], state):
        return None
    factors = graph.pair(sides[1], "Mul")
    # nnodely writes its own loops with the operands in this order
    if factors is None or factors[1] != _STEP:
        return None
    half = graph.pair(factors[0], "Mul")
    # looked for first: the sum of two samples is an integrand of the other form as well
    if half is not None and graph.is_constant(half[1], 0.5):
        sums = graph.pair(half[0], "Add")
        buffer = None if sums is None else _neighbours(graph, *sums)
        if buffer is not None:
            return _of_past("integral", ", method=trapezoidal", buffer, graph)
    integrand = factors[0]
    # an integral of a parameter: left to be followed as it stands
    if integrand not in graph.file.Relations:
        return None

    def make(relations: Followed) -> Value:
        return _called("integral", "", relations.operand(integrand))

    return Recognised((integrand,), make)


def _ringing(graph: Graph, state: str, source: str) -> Recognised | None:
    sides = graph.pair(source, "Sub")
    if sides is None or not _is_own_past(graph, sides[1], state):
        return None
    # d = (e − e[t−1]) 2 / dt − d[t−1] has its pole at −1: an error of d stays, with changing sign
    quotient = graph.pair(sides[0], "Div")
    double = None if quotient is None else graph.pair(quotient[0], "Mul")
    if quotient is None or quotient[1] != _STEP or double is None:
        return None
    step = graph.pair(double[0], "Sub")
    buffer = None if step is None else _neighbours(graph, *step)
    if buffer is None or not graph.is_constant(double[1], 2.0):
        return None
    return _of_past("der", ", method=trapezoidal", buffer, graph)


def _slope(graph: Graph, name: str) -> str | None:
    """The buffer whose derivative a relation is, computed from its newest samples."""
    quotient = graph.pair(name, "Div")
    if quotient is None or quotient[1] != _STEP:
        return None
    step = graph.pair(quotient[0], "Sub")
    return None if step is None else _neighbours(graph, *step)


def _neighbours(graph: Graph, newest: str, older: str) -> str | None:
    """The connected buffer whose two newest samples these relations are."""
    buffer = graph.sample(newest, 0)
    if buffer is None or graph.sample(older, 1) != buffer:
        return None
    given = graph.file.Inputs[buffer]
    # exactly two samples: a longer buffer is read elsewhere, too
    is_short = given.sw == [-2, 0] and given.tw is None and given.connect is not None
    return buffer if is_short and given.connect in graph.file.Relations else None


def _is_own_past(graph: Graph, name: str, state: str) -> bool:
    """True if a relation is the state's previous value and has no other use."""
    given = graph.file.Inputs[state]
    is_last = graph.sample(name, 0) == state and given.sw == [-1, 0] and given.tw is None
    # a state that others read has to stay one
    return is_last and graph.uses[name] == 1 and graph.uses[state] == 1


def _of_past(function: str, rest: str, buffer: str, graph: Graph) -> Recognised:
    source = graph.file.Inputs[buffer].connect
    assert source is not None

    def make(relations: Followed) -> Value:
        assert relations.signals is not None
        return _called(function, rest, relations.signals.kept_past(buffer))

    return Recognised((source,), make)


def _called(function: str, rest: str, value: Value) -> Value:
    if value.window != 1:
        raise ShapeError("an integral or derivative in time of more than one sample")
    head = Call(function, rest, steady=False)
    return Value(1, value.dim, (Term(head, (value.pieces[0],), None, value.dim),))

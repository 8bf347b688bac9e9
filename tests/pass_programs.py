"""Programs made to show what one pass does."""

from __future__ import annotations

from collections.abc import Callable

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Add, Multiply, Relation
from compiler.ir.program import (
    Declared,
    Expected,
    Graph,
    Loss,
    Measure,
    Node,
    Output,
    Parameter,
    Program,
    Role,
    Signal,
    State,
)
from compiler.ir.types import WINDOW, Axis, Prediction, Type
from compiler.layers.rules.fuzzy_sets import FuzzySets, triangular
from compiler.passes.simplify import fold_constants
from compiler.passes.to_step_form import to_step_form
from spec_schema.diagnostics.source import Span
from spec_schema.units.parser import parse_unit

METRE = parse_unit("m")


def numbers() -> Program:
    """Constants in chains, in a vector, behind a choice, repeated, and one that is not finite."""
    b = GraphBuilder()
    k = Axis("k", 3)
    x = b.signal("x", 0, 0, Type())
    root = b.apply("sqrt", b.multiply(b.constant(2.0), b.constant(4.5)))
    spread = b.multiply(b.constant((1.0, 2.0, 3.0), (k,)), root)
    repeated = b.broadcast(b.constant(7.0), (k,))
    chosen = b.select(b.compare(Relation.LESS, b.constant(1.0), root), x, b.negate(x))
    infinite = b.divide(b.constant(1.0), b.constant(0.0))
    outputs = (
        Output("scaled", b.multiply(b.broadcast(x, (k,)), spread)),
        Output("shifted", b.add(b.broadcast(x, (k,)), repeated)),
        Output("chosen", chosen),
        Output("limited", b.minimum(x, infinite)),
    )
    signals = (Signal("x", Role.INPUT),)
    return Program("numbers", None, signals, (), (), b.graph(), Graph(), outputs)


def twins() -> Program:
    """The same product three times, written as a pass might leave it."""
    read = GraphBuilder()
    x = read.signal("x", 0, 0, Type((), METRE))
    square = Type((), METRE * METRE)

    def at(line: int) -> Span:
        return Span(file="twins.msnn.yaml", line=line, column=1, end_line=line, end_column=8)

    nodes = (
        read.node(x),
        Node(Multiply(), (x, x), square, at(4), "area"),
        Node(Multiply(), (x, x), square, at(7), "other_area"),
        Node(Add(), (1, 2), square, at(8)),
        Node(Multiply(), (x, x), square),
        Node(Add(), (3, 4), square, at(9), "sum"),
    )
    signals = (Signal("x", Role.INPUT, (), METRE),)
    outputs = (Output("sum", 5), Output("area", 2))
    return Program("twins", None, signals, (), (), Graph(nodes), Graph(), outputs)


def named() -> Program:
    """The same product as a variable of a gradient, which gives it its unit, and as no variable."""
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    product = b.multiply(b.constant(2.0), x)
    variable = b.named(product, "e")
    b.set_unit(variable, METRE)
    b.name(variable, "e")
    outputs = (Output("e", variable), Output("sum", b.add(variable, product)))
    signals = (Signal("x", Role.INPUT),)
    return Program("named", None, signals, (), (), b.graph(), Graph(), outputs)


def branches() -> Program:
    """A root and a quotient that only one branch takes, and a root that another output needs."""
    b = GraphBuilder()
    x, y = b.signal("x", 0, 0, Type()), b.signal("y", 0, 0, Type())
    zero, one = b.constant(0.0), b.constant(1.0)
    positive = b.compare(Relation.GREATER, x, zero)
    shared = b.apply("sqrt", y)
    taken = b.add(b.apply("sqrt", x), b.divide(one, x))
    outputs = (
        Output("guarded", b.select(positive, taken, zero)),
        Output("open", b.select(positive, shared, zero)),
        Output("root", shared),
    )
    signals = (Signal("x", Role.INPUT), Signal("y", Role.INPUT))
    return Program("branches", None, signals, (), (), b.graph(), Graph(), outputs)


def steep() -> Program:
    """Functions with an infinite slope somewhere, and two that are kept away from there."""
    b = GraphBuilder()
    x, y = b.signal("x", 0, 0, Type()), b.signal("y", 0, 0, Type())
    one = b.constant(1.0)
    away = b.add(one, b.multiply(x, x))
    outputs = (
        Output("log", b.apply("log", x)),
        Output("arc", b.apply("acos", x)),
        Output("power", b.apply("pow", x, y)),
        Output("away", b.divide(b.apply("sqrt", away), b.apply("exp", x))),
    )
    signals = (Signal("x", Role.INPUT), Signal("y", Role.INPUT))
    return Program("steep", None, signals, (), (), b.graph(), Graph(), outputs)


def kinks() -> Program:
    """Kinks that the range of x reaches, one that it does not, and one of no known range."""
    b = GraphBuilder()
    x, free = b.signal("x", 0, 0, Type()), b.signal("free", 0, 0, Type())
    zero, far = b.constant(0.0), b.constant(5.0)
    root = b.apply("sqrt", x)
    positive = b.compare(Relation.GREATER, x, zero)
    outputs = (
        Output("abs", b.apply("abs", x)),
        Output("relu", b.maximum(zero, x)),
        Output("root", root),
        Output("chosen", b.select(positive, root, x)),
        Output("kept", b.select(positive, b.apply("log", x), x)),
        Output("far", b.minimum(x, far)),
        Output("free", b.apply("abs", free)),
    )
    signals = (Signal("x", Role.INPUT, range=(-2.0, 2.0)), Signal("free", Role.INPUT))
    return Program("kinks", None, signals, (), (), b.graph(), Graph(), outputs)


def leftovers() -> Program:
    """A state, a parameter, an input and nodes that no output needs; a target that a loss needs."""
    b, starts = GraphBuilder(), GraphBuilder()
    x, idle = b.signal("x", 0, 0, Type()), b.signal("idle", 0, 0, Type())
    gain, spare = b.parameter("gain", Type()), b.parameter("spare", Type())
    count, forgotten = b.state("count", Type()), b.state("forgotten", Type())
    unread = b.multiply(forgotten, b.add(idle, spare))
    kept = b.multiply(gain, b.add(x, count))
    scored = b.apply("abs", b.subtract(kept, x))
    target = b.log("y", 0, 0, Type())
    zero, begun = starts.constant(0.0), starts.parameter("spare", Type())
    return Program(
        name="leftovers",
        sample_time=1.0,
        signals=(
            Signal("x", Role.INPUT),
            Signal("idle", Role.INPUT),
            Signal("y", Role.TARGET),
        ),
        parameters=(Parameter("gain"), Parameter("spare")),
        states=(
            State("count", (), None, Declared(), b.add(count, b.constant(1.0)), zero),
            State("forgotten", (), None, Declared(), unread, begun),
        ),
        step=b.graph(),
        start=starts.graph(),
        outputs=(Output("kept", kept, Prediction("y", 0)), Output("scored", scored)),
        losses=(Loss("kept", Measure.MSE, kept, target),),
    )


def functions() -> Program:
    """A tangent, and a hyperbolic sine whose definition needs another definition."""
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    tangent, sine = b.apply("tan", x), b.apply("sinh", x)
    b.name(tangent, "slope")
    outputs = (Output("tangent", tangent), Output("sine", sine))
    signals = (Signal("x", Role.INPUT),)
    return Program("functions", None, signals, (), (), b.graph(), Graph(), outputs)


def mapped_windows() -> Program:
    """Two functions of windows of an input, a sample of it, and a window that is only scaled."""
    b = GraphBuilder()
    window, short = Type((Axis("t", 4),)), Type((Axis("t", 3),))
    angle = b.signal("angle", -3, 0, window)
    phase = b.add(
        b.multiply(b.signal("angle", -2, 0, short), b.parameter("k", Type())), b.constant(1.0)
    )
    level = b.subtract(b.signal("level", -3, 0, window), b.constant(0.5))
    b.name(level, "offset_free")
    waves = b.add(b.sum(b.apply("cos", phase), "t"), b.sum(b.apply("sin", angle), "t"))
    late = b.signal("angle", -1, -1, Type())
    outputs = (Output("waves", b.add(waves, late)), Output("level", b.sum(level, "t")))
    signals = (Signal("angle", Role.INPUT), Signal("level", Role.INPUT))
    parameters = (Parameter("k", initial=(0.7,)),)
    made = Program("mapped", 0.1, signals, parameters, (), b.graph(), Graph(), outputs)
    return to_step_form(made)


def local_models() -> Program:
    """The sum of three cells under hat functions, and of the same cells under all degrees."""
    b = GraphBuilder()
    rule = Axis("rule", 3)
    x = b.signal("x", 0, 0, Type())
    degrees = triangular(FuzzySets(b, x, rule, b.constant((-1.0, 0.0, 2.0), (rule,))))
    gains = b.parameter("gain", Type((rule,)))
    cells = b.multiply(gains, x)
    outputs = (
        Output("active", b.contract_over(degrees, cells, "rule")),
        Output("all", b.sum(cells, "rule")),
    )
    signals, parameters = (
        (Signal("x", Role.INPUT),),
        (Parameter("gain", (rule,), None, (1.0, 2.0, 3.0)),),
    )
    program = Program("cells", None, signals, parameters, (), b.graph(), Graph(), outputs)
    return fold_constants(program)


def dropouts() -> Program:
    """What a loss reads behind the dropout of two layers, and an output without any."""
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type((Axis("joint", 2),)))
    learned, frozen = b.dropout(x, 0.25, "learned"), b.dropout(b.negate(x), 0.5, "frozen")
    losses = (Loss("size", Measure.MEAN, b.multiply(learned, frozen), None),)
    signals = (Signal("x", Role.INPUT, (Axis("joint", 2),)),)
    outputs = (Output("same", x),)
    return Program("dropouts", None, signals, (), (), b.graph(), Graph(), outputs, losses)


def expectations() -> Program:
    """An equation with a range that two others use, one over a window, and an unlimited output."""
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type((), METRE))
    e = b.multiply(b.constant(2.0), x)
    past = b.apply("abs", b.signal("x", -2, 0, Type((Axis(WINDOW, 3),), METRE)))
    outputs = (Output("sum", b.add(e, b.sum(past, WINDOW))), Output("e", e), Output("x", x))
    return Program(
        "expectations",
        0.1,
        (Signal("x", Role.INPUT, (), METRE),),
        (),
        (),
        b.graph(),
        Graph(),
        outputs,
        expected=(Expected("e", e, (-1.0, 1.0)), Expected("past", past, (0.0, 2.0))),
    )


def units_of_0() -> Program:
    """Four units over three taps: units 1 and 3 and the oldest tap are not used."""
    b = GraphBuilder()
    unit, tap = Axis("unit", 4), Axis(WINDOW, 3)
    x = b.signal("x", -2, 0, Type((tap,)))
    taps = b.parameter("taps", Type((unit, tap)))
    hidden = b.add(b.contract_over(taps, x, WINDOW), b.parameter("bias", Type((unit,))))
    y = b.contract_over(b.parameter("out", Type((unit,))), b.apply("tanh", hidden), "unit")
    parameters = (
        Parameter("taps", (unit, tap), initial=(0.0, 1.0, 2.0) * 4),
        Parameter("bias", (unit,), initial=(1.0, 2.0, 3.0, 4.0)),
        Parameter("out", (unit,), initial=(1.0, 0.0, 2.0, 0.0)),
    )
    signals = (Signal("x", Role.INPUT),)
    outputs = (Output("y", y),)
    return Program("units", None, signals, parameters, (), b.graph(), Graph(), outputs)


def single_numbers() -> Program:
    """A polynomial of which two coefficients, `off`, are 0."""
    b = GraphBuilder()
    x, w = b.signal("x", 0, 0, Type()), b.signal("w", 0, 0, Type())
    on, off = b.parameter("on", Type()), b.parameter("off", Type())
    square = b.multiply(off, b.multiply(x, x))
    y = b.subtract(b.add(square, b.multiply(on, x)), b.multiply(off, b.apply("sin", w)))
    parameters = (Parameter("on"), Parameter("off"))
    signals = (Signal("x", Role.INPUT), Signal("w", Role.INPUT))
    outputs = (Output("y", y),)
    return Program("numbers", None, signals, parameters, (), b.graph(), Graph(), outputs)


PASS_PROGRAMS: dict[str, Callable[[], Program]] = {
    "numbers": numbers,
    "branches": branches,
    "steep": steep,
    "kinks": kinks,
    "twins": twins,
    "named": named,
    "leftovers": leftovers,
    "functions": functions,
    "mapped_windows": mapped_windows,
    "local_models": local_models,
    "dropouts": dropouts,
    "expectations": expectations,
    "units_of_0": units_of_0,
    "single_numbers": single_numbers,
}

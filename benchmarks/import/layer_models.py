"""Builds a small model of every layer of nnodely, and of every way to connect them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nnodely import *  # noqa: F403

MODELS: dict[str, Callable[[Any], None]] = {}


def model(build: Callable[[Any], None]) -> Callable[[Any], None]:
    """A decorator that lists a builder of a model; the builder adds outputs to the model."""
    MODELS[build.__name__] = build
    return build


# ruff: noqa: F405


@model
def windows(m):
    x = Input("x")
    y = Input("y", dimensions=3)
    m.addModel(
        "m",
        [
            Output("o1", x.sw(4)),
            Output("o2", x.sw([-3, 1])),
            Output("o3", x.z(2) + x.next()),
            Output("o4", x.tw(0.3)),
            Output("o5", x.tw([-0.4, 0.2])),
            Output("o6", y.last()),
            Output("o7", y.sw(2)),
        ],
    )


@model
def offsets(m):
    x = Input("x")
    m.addModel(
        "m",
        [
            Output("o1", x.sw(4, offset=-1)),
            Output("o2", x.sw([-3, 2], offset=-3)),
            Output("o3", x.tw([-0.3, 0.2], offset=-0.1)),
        ],
    )


@model
def parts(m):
    x = Input("x")
    y = Input("y", dimensions=4)
    w = x.sw([-5, 2])
    m.addModel(
        "m",
        [
            Output("o1", Part(y.last(), 1, 3)),
            Output("o2", Select(y.sw(3), 2)),
            Output("o3", SamplePart(w, 1, 5)),
            Output("o4", SampleSelect(w, 3)),
            Output("o5", SamplePart(w, 1, 5, offset=2)),
            Output("o6", TimePart(x.tw([-0.5, 0.2]), 0.1, 0.4)),
            Output("o7", SamplePart(Tanh(w) * w, 2, 6)),
        ],
    )


@model
def joins(m):
    x, z = Input("x"), Input("z")
    y = Input("y", dimensions=2)
    both = TimeConcatenate(x.sw(2), z.sw(3))
    m.addModel(
        "m",
        [
            Output("o1", Concatenate(x.last(), y.last())),
            Output("o2", Concatenate(x.sw(3), z.sw(3))),
            Output("o3", both),
            Output("o4", Fir(Tanh(both))),
            Output("o5", Fir(3, b=True)(TimeConcatenate(both, x.sw(2)) * 2)),
            Output("o6", TimeConcatenate(y.sw(2), y.sw([-4, -3]))),
            Output("o7", both + x.sw(5)),
        ],
    )


@model
def arithmetic(m):
    x, z = Input("x"), Input("z")
    y = Input("y", dimensions=3)
    k = Parameter("k", dimensions=1, values=[0.7])
    v = Parameter("v", dimensions=3, values=[0.5, -1.0, 2.0])
    c = Constant("c", values=[1.5])
    w = Parameter("w", sw=3, values=[[1.0], [2.0], [3.0]])
    a, b = x.last(), z.last()
    m.addModel(
        "m",
        [
            Output("o1", (a + b) * k - a / (b * b + 2.0)),
            Output("o2", -a + 3 - 2 * b),
            Output("o3", a**2 + 2**a),
            Output("o4", (a * a + 1) ** (b * 0.3)),
            Output("o5", y.last() * v - c),
            Output("o6", Sum(y.last())),
            Output("o7", Sign(a - 0.1)),
            Output("o8", x.sw(3) * w + k),
            Output("o9", a * SampleTime() + (a - (b - a)) - (a / (b + 5)) / 2),
            Output("o10", Sum(y.sw(2) * 2)),
            Output("o11", (-a) ** 2 - (-(a**2))),
        ],
    )


@model
def functions(m):
    x = Input("x")
    y = Input("y", dimensions=3)
    a = x.last()
    m.addModel(
        "m",
        [
            Output("o1", Sin(a) + Cos(a) * Tan(a * 0.3)),
            Output("o2", Tanh(a) + Cosh(a) - Sech(a)),
            Output("o3", Relu(x.sw(3)) + ELU(x.sw(3)) * Sigmoid(x.sw(3))),
            Output("o4", Softmax(y.last())),
            Output("o5", Softmax(y.sw(2))),
            Output("o6", Identity(a)),
        ],
    )


@model
def filters(m):
    x = Input("x")
    shared = Parameter("W", sw=4, values=[[0.1], [0.2], [0.3], [0.4]])
    both = Fir(2, b=True)
    m.addModel(
        "m",
        [
            Output("o1", Fir(x.sw(5))),
            Output("o2", Fir(3)(x.tw(0.4))),
            Output("o3", Fir(2, b=True, W_init="init_exp")(x.sw([-4, 1]))),
            Output("o4", Fir(b=True)(x.last())),
            Output("o5", Fir(W=shared)(x.sw(4)) + Fir(W=shared, b=True)(x.sw([-5, -1]))),
            Output("o6", Tanh(x.sw(4) * shared)),
            Output("o7", both(x.sw(3)) * both(x.sw([-4, -1]))),
            Output("o8", Fir(W="named", b="offset")(x.sw(2))),
        ],
    )


@model
def linears(m):
    x = Input("x")
    y = Input("y", dimensions=3)
    square = Parameter("S", dimensions=[3, 3], values=[[1.0, 2, 3], [0, 1, 0.5], [-1, 0.2, 0.1]])
    m.addModel(
        "m",
        [
            Output("o1", Linear(y.last())),
            Output("o2", Linear(3, b=True)(y.sw(2))),
            Output("o3", Linear(2)(x.last())),
            Output("o4", Linear(b=True)(x.sw(3))),
            Output("o5", Linear(W=square)(y.last())),
            Output("o6", Linear(W=square, b=True)(Tanh(y.last()))),
            Output("o7", Linear(2)(Tanh(Linear(4, b=True)(y.last())))),
        ],
    )


def bump(x):
    import_free = x * x
    return torch.exp(-import_free)


def wave(x):
    return torch.sin(x) / 2


@model
def fuzzy_sets(m):
    x = Input("x")
    a = x.last()
    m.addModel(
        "m",
        [
            Output("o1", Fuzzify(5, [-2, 2])(a)),
            Output("o2", Fuzzify(7, [0, 1])(a)),
            Output("o3", Fuzzify(centers=[-1, 0, 3, 5], functions="Triangular")(x.sw(3))),
            Output("o4", Fuzzify(4, [-1, 1], functions="Rectangular")(a)),
            Output("o5", Fuzzify(3, [-1, 1], functions=bump)(a)),
            Output("o6", Fuzzify(5, [-2, 2], functions=[bump, wave])(a)),
            Output("o7", Fuzzify(centers=[0.5])(a)),
            Output("o8", Fuzzify(centers=[2, 1, -1])(a)),
            Output("o9", Fuzzify(centers=[2, 1, -1], functions="Rectangular")(a)),
            Output("o10", Fir(Fuzzify(centers=[0.5])(x.sw(2)))),
        ],
    )


@model
def tables(m):
    x = Input("x")
    a = x.last()
    m.addModel(
        "m",
        [
            Output("o1", Interpolation([1.0, 2.0, 3.0, 4.0], [1.0, 4.0, 9.0, 16.0])(a)),
            Output("o2", Interpolation([10.0, 0.0, 1.0], [100.0, 0.0, 1.0])(a * 2)),
            Output("o3", Interpolation([0.0, 1.0], [2.0, 3.0])(a)),
        ],
    )


@model
def local_models(m):
    x, v = Input("x"), Input("v")
    act = Fuzzify(3, [-1, 1])(v.last())
    act2 = Fuzzify(centers=[-1, 1])(x.last())
    m.addModel(
        "m",
        [
            Output("o1", LocalModel(input_function=lambda: Fir(b=True))(x.sw(4), act)),
            Output("o2", LocalModel(input_function=lambda: Fir)(x.sw(3), (act, act2))),
            Output("o3", LocalModel()(x.last(), act)),
            Output("o4", LocalModel(output_function=lambda: Fir(2))(x.last(), (act, act2))),
            Output("o5", LocalModel(input_function=Fir(b=True))(x.sw(4), act)),
            Output("o6", LocalModel(input_function=lambda: Linear(b=True))(x.last(), act)),
        ],
    )


def one_cell(x, k, c):
    return k * x + c


@model
def local_functions(m):
    x, v = Input("x"), Input("v")
    act = Fuzzify(4, [-1, 1])(v.last())
    m.addModel(
        "m", [Output("o1", LocalModel(input_function=lambda: ParamFun(one_cell))(x.last(), act))]
    )


def indexed(i):
    return Fir(W=Parameter(f"cell_{i[0]}", sw=3, values=[[i[0] + 1.0], [0.5], [2.0]]))


@model
def local_indexes(m):
    x, v = Input("x"), Input("v")
    act = Fuzzify(3, [-1, 1])(v.last())
    local = LocalModel(input_function=indexed, pass_indexes=True)
    m.addModel("m", [Output("o1", local(x.sw(3), act))])


@model
def equation_learners(m):
    x = Input("x")
    y = Input("y", dimensions=2)
    m.addModel(
        "m",
        [
            Output("o1", EquationLearner([Tanh, Sin, Mul, Add, Identity])(x.last())),
            Output("o2", EquationLearner([Sin, Mul], linear_out=Linear(1, b=True))(y.last())),
            Output("o3", EquationLearner([Sub, Neg, Relu])((x.last(), y.last()))),
            Output("o4", EquationLearner([Cos, Add])(x.sw(3))),
        ],
    )


@model
def integrals(m):
    x = Input("x")
    y = Input("y", dimensions=2)
    m.addModel(
        "m",
        [
            Output("o1", Integrate(x.last())),
            Output("o2", Integrate(x.last(), method="trapezoidal")),
            Output("o3", x.s(-2)),
            Output("o4", Integrate(y.last() * 2)),
        ],
    )


@model
def derivatives(m):
    x = Input("x")
    m.addModel(
        "m",
        [
            Output("o1", Differentiate(x.last())),
            Output("o2", Differentiate(x.last(), method="trapezoidal")),
            Output("o3", x.s(2)),
            Output("o4", Integrate(Differentiate(Tanh(x.last())))),
            Output("o5", Differentiate(x.last() * 3) + x.last()),
        ],
    )


@model
def gradients(m):
    x, z = Input("x"), Input("z")
    a = x.last()
    f = Tanh(a * a + z.last()) * a
    m.addModel(
        "m",
        [
            Output("o1", Differentiate(f, a)),
            Output("o2", Differentiate(Differentiate(f, a), a)),
        ],
    )


@model
def histories(m):
    x = Input("x")
    e = Tanh(x.last()) + 1
    m.addModel(
        "m",
        [
            Output("o1", e.sw(3)),
            Output("o2", e.z(2)),
            Output("o3", e.sw([-4, -1])),
            Output("o4", Fir(e.sw(5))),
            Output("o5", (x.sw(3) + 1).sw(4)),
            Output("o6", (x.sw(3) * 2).sw(2)),
            Output("o7", Tanh(x.tw(0.2)).delay(0.1)),
            Output("o8", e.sw(3, offset=-2)),
        ],
    )


@model
def closed_loop(m):
    x, u = Input("x"), Input("u")
    m.addModel("m", [Output("x_next", Fir(x.sw(3)) * 0.5 + Fir(u.sw(2)))])
    m.addClosedLoop("x_next", "x")


@model
def closed_loop_inside(m):
    x, u = Input("x"), Input("u")
    step = (x.last() * 0.9 + u.last() * 0.1).closedLoop(x)
    m.addModel("m", [Output("y", Tanh(step))])


@model
def closed_vector(m):
    x, u = Input("x", dimensions=2), Input("u")
    m.addModel("m", [Output("x_next", Tanh(Linear(2)(x.last())) + Linear(2, b=True)(u.last()))])
    m.addClosedLoop("x_next", "x")


@model
def closed_with_target(m):
    x, u = Input("x"), Input("u")
    out = Output("x_next", Fir(x.sw(2)) * 0.5 + Fir(u.last()))
    m.addModel("m", [out])
    m.addMinimize("err", out, x.next())
    m.addClosedLoop(out, x)


@model
def closed_window(m):
    x, u = Input("x"), Input("u")
    m.addModel("m", [Output("y", x.sw(3) * 0.5 + u.sw(3))])
    m.addClosedLoop("y", "x")


@model
def closed_ahead(m):
    x, u = Input("x"), Input("u")
    m.addModel("m", [Output("y", Fir(x.sw([0, 3])) * 0.2 + u.last()), Output("z", x.sw([-1, 1]))])
    m.addMinimize("fit", "y", x.next())
    m.addClosedLoop("y", "x")


@model
def connected(m):
    x, u = Input("x"), Input("u")
    plant = x.last() * 0.8 + u.last() + u.z(1) * 0.1
    control = Linear(b=True)(x.last())
    m.addModel("plant", [Output("x_next", plant)])
    m.addModel("control", [Output("command", control)])
    m.addConnect("command", "u")
    m.addClosedLoop("x_next", "x")


@model
def connected_window(m):
    x, u = Input("x"), Input("u")
    m.addModel("a", [Output("y", Fir(u.sw(5)))])
    m.addModel("b", [Output("w", Tanh(x.sw(3)))])
    m.addConnect("w", "u")


@model
def losses(m):
    x, y, z = Input("x"), Input("y"), Input("z", dimensions=2)
    out = Output("out", Fir(x.sw(3)))
    both = Output("both", Linear(2)(x.last()))
    m.addModel("m", [out, both])
    m.addMinimize("first", out, y.next())
    m.addMinimize("second", both, z.last(), "rmse")
    m.addMinimize("third", Tanh(x.last()), y.last(), "mae")


def field(x):
    return -2 * x


@model
def solvers(m):
    x = Input("x")
    m.addModel(
        "m",
        [
            Output("o1", ForwardEuler(field)(x.last())),
            Output("o2", RK2(field)(x.last())),
            Output("o3", RK4(field)(x.last())),
        ],
    )


@model
def solved_loop(m):
    x = Input("x")
    m.addModel("m", [Output("x_next", RK4(field)(x.last()))])
    m.addClosedLoop("x_next", "x")


@model
def names(m):
    x, dt, lam = Input("x dot"), Input("dt"), Input("sin")
    m.addModel("m", [Output("sum", x.last() + dt.last()), Output("größe", lam.last() * 2)])


@model
def dropout(m):
    x = Input("x")
    m.addModel("m", [Output("o1", Fir(2, dropout=1e-9)(x.sw(3)))])


@model
def several_models(m):
    x, u, y = Input("x"), Input("u"), Input("y")
    gain = Parameter("gain", dimensions=1, values=[0.3])
    first = Output("a", Fir(x.tw(0.4)) * gain + Fir(u.last()))
    second = Output("b", Linear(2, b=True)(Fir(2)(y.sw(3))) * gain)
    m.addModel("first", [first])
    m.addModel("second", [second])
    m.addMinimize("a", first, x.next())
    m.addMinimize("b", Output("c", Sum(Fir(2)(y.sw(2)))), y.next(), "mae")


@model
def loops_in_seconds(m):
    x, v, u = Input("x"), Input("v"), Input("u")
    speed = Fir(v.tw(0.3)) * 0.4 + Fir(u.tw([-0.2, 0]))
    place = x.last() + speed * SampleTime()
    m.addModel("m", [Output("v_next", speed), Output("x_next", place)])
    m.addClosedLoop("v_next", "v")
    m.addClosedLoop("x_next", "x")


@model
def forms_of_connections(m):
    x, u, w = Input("x"), Input("u"), Input("w")
    one = Connect(Tanh(x.last()), u)
    two = ClosedLoop(u.last() * 0.5 + w.last(), w)
    m.addModel("m", [Output("o1", one), Output("o2", two), Output("o3", Fir(u.sw(3)))])


@model
def initialisers(m):
    x = Input("x")
    m.addModel(
        "m",
        [
            Output("o1", Fir(W_init="init_negexp")(x.sw(4))),
            Output("o2", Fir(2, W_init="init_lin", b_init="init_constant", b=True)(x.sw(3))),
            Output("o3", Fir(W=Parameter("T", tw=0.3, dimensions=1, init="init_exp"))(x.tw(0.3))),
        ],
    )


@model
def both_functions_of_cells(m):
    x, v, w = Input("x"), Input("v"), Input("w")
    sets = Fuzzify(2, [-1, 1])(v.last())
    others = Fuzzify(2, [0, 2])(w.last())
    local = LocalModel(
        input_function=lambda: Fir(b=True), output_function=lambda: ParamFun(one_cell)
    )
    same = LocalModel(input_function=lambda: Fir(b=True))
    m.addModel(
        "m",
        [
            Output("o1", local(x.sw(3), (sets, others))),
            Output("o2", same(x.sw(3), (sets, others))),
            Output("o3", same(x.sw(2), (others, sets))),
        ],
    )


@model
def past_of_vectors(m):
    y = Input("y", dimensions=3)
    e = Tanh(Linear(2)(y.last()))
    m.addModel(
        "m",
        [
            Output("o1", e.sw(3)),
            Output("o2", Linear(2, b=True)(e.z(1)) + e),
            Output("o3", TimeConcatenate(e.sw(2), e)),
            Output("o4", Integrate(e) - Differentiate(e)),
        ],
    )


@model
def one_set_and_windows(m):
    x, z = Input("x"), Input("z")
    m.addModel(
        "m",
        [
            Output("o1", Fuzzify(3, [-1, 1])(x.sw(2)) * Fuzzify(3, [-2, 1])(z.sw(2))),
            Output("o2", Sum(Fuzzify(3, [-1, 1])(x.last()) * Fuzzify(3, [-2, 1])(z.last()))),
            Output("o3", Softmax(Concatenate(x.last(), z.last())) * 2),
            Output("o4", Linear(Concatenate(x.sw(3), z.sw(3)))),
        ],
    )

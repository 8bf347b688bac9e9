"""Builds models of a thousand relations and more."""

from __future__ import annotations

from layer_models import model, one_cell
from nnodely import *  # noqa: F403

# ruff: noqa: F405


@model
def large_grid(m):
    x, v = Input("x"), Input("v")
    sets = Fuzzify(14, [-1, 1])(v.last())
    others = Fuzzify(15, [-1, 1])(x.last())
    local = LocalModel(input_function=lambda: Fir(b=True))
    m.addModel("m", [Output("y", local(x.sw(4), (sets, others)))])


@model
def large_learner(m):
    x, u = Input("x"), Input("u")
    learner = EquationLearner([Sin, Tanh, Mul, Identity] * 80)
    m.addModel("m", [Output("y", Linear(2)(learner((x.last(), u.last()))))])


@model
def large_functions(m):
    x, v = Input("x"), Input("v")
    sets = Fuzzify(260, [-2, 2])(v.last())
    local = LocalModel(input_function=lambda: ParamFun(one_cell))
    m.addModel("m", [Output("y", local(x.last(), sets))])


@model
def large_loop(m):
    x, u = Input("x"), Input("u")
    y = x.last() * 0.5
    for i in range(260):
        y = y + Fir(b=True)(x.sw(2 + i % 4)) * 0.01 + Sin(u.z(i % 4))
    m.addModel("m", [Output("x_next", Tanh(y * 0.05))])
    m.addClosedLoop("x_next", "x")


@model
def large_vectors(m):
    x = Input("x", dimensions=4)
    y = x.last()
    for i in range(260):
        y = y + Tanh(Linear(4, b=True)(x.z(i % 4))) * 0.1
    m.addModel("m", [Output("y", y)])

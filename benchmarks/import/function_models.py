"""Builds models of functions in Python, as users of nnodely write them."""

from __future__ import annotations

import torch
from layer_models import model
from nnodely import *  # noqa: F403

# ruff: noqa: F405


def linear(a, b, K, g):
    return a * K + b * g


def polynomial(x, c0, c1, c2):
    """A polynomial in Horner's form."""
    y = c2 * x + c1
    return y * x + c0


def friction(v, k, c):
    direction = torch.tanh(v / 0.1)
    return k * direction + c * v + torch.where(torch.abs(v) > 0.5, 0.1, -0.1)


def magic(a, b, c, d):
    return d * torch.sin(c * torch.atan(b * a - 0.1 * (b * a - torch.atan(b * a))))


def joined(x, y):
    return torch.cat((x, y, x * y), dim=2)


def mixed(x, w):
    return torch.matmul(x, w)


def energy(x):
    return torch.sum(x**2, dim=2, keepdim=True)


def latest(x):
    return x[:, -1:, :] - x[:, 0:1, :]


def turned(x):
    return x.transpose(1, 2)


def second(x):
    return x[:, :, 1].unsqueeze(-1)


def swinging(x, y):
    s, c = torch.sin(x), torch.cos(x)
    return torch.stack([s * y, c * y], dim=-1).squeeze(-2)


def clamped(x):
    return torch.clamp(x, -0.5, 0.5) + torch.clamp(x, min=0.2) + torch.relu(x)


def repeated(x, k):
    total = torch.zeros_like(x)
    for i in range(3):
        total = total + k[i] * x ** (i + 1)
    return total


def between(x):
    return torch.where((x > -0.5) & (x < 0.5), x, torch.sign(x) * 0.5)


def averaged(x):
    return torch.mean(x, dim=1, keepdim=True)


def per_sample(x, k):
    return k * x.sum() + x


def rotated(x, angle):
    c = torch.cos(angle)
    s = torch.sin(angle)
    first = c * x[:, :, 0:1] - s * x[:, :, 1:2]
    other = s * x[:, :, 0:1] + c * x[:, :, 1:2]
    return torch.cat([first, other], dim=-1)


def shaped(x):
    return x.reshape(x.shape[0], 1, -1)


def selected(x):
    if x.shape[1] > 2:
        return torch.max(x, torch.zeros_like(x))
    return x


def constants(x, c):
    return torch.exp(-x.pow(2) / c) * torch.pi


def wheel(slip, load, k, e):
    scaled = load / 2.0
    return k[0] * scaled * torch.tanh(e * slip) + k[1] * torch.square(slip)


@model
def plain_functions(m):
    x, z = Input("x"), Input("z")
    a, b = x.last(), z.last()
    K = Parameter("K", dimensions=1, values=[0.5])
    g = Constant("g", values=[9.81])
    m.addModel(
        "m",
        [
            Output("o1", ParamFun(linear, [K, g])(a, b)),
            Output("o2", ParamFun(polynomial)(a)),
            Output("o3", ParamFun(friction)(x.sw(3))),
            Output("o4", ParamFun(magic, {"b": 1.5, "c": 1.2})(a)),
            Output("o5", ParamFun(clamped)(a)),
            Output("o6", ParamFun(between)(x.sw(2))),
            Output("o7", ParamFun(constants, [[0.5]])(a)),
            Output("o8", ParamFun(linear, [K, 2.0])(x.sw(3), z.sw(3))),
        ],
    )


@model
def moving_functions(m):
    x = Input("x")
    y, z = Input("y", dimensions=2), Input("z", dimensions=3)
    m.addModel(
        "m",
        [
            Output("o1", ParamFun(joined)(x.last(), x.z(2))),
            Output("o2", ParamFun(mixed, [(3, 2)])(z.last())),
            Output("o3", ParamFun(energy)(z.sw(2))),
            Output("o4", ParamFun(latest)(z.sw(4))),
            Output("o5", ParamFun(turned)(z.last())),
            Output("o6", ParamFun(second)(z.sw(2))),
            Output("o7", ParamFun(swinging)(x.last(), x.z(1))),
            Output("o8", ParamFun(repeated, [(3,)])(x.sw(2))),
            Output("o9", ParamFun(averaged)(z.sw(3))),
            Output("o10", ParamFun(rotated)(y.last())),
            Output("o11", ParamFun(shaped)(z.sw(2))),
            Output("o12", ParamFun(selected)(x.sw(3))),
            Output("o13", ParamFun(wheel, [(2,), 3.0])(x.last(), x.z(1))),
        ],
    )


@model
def mapped_functions(m):
    x, z = Input("x"), Input("z", dimensions=3)
    m.addModel(
        "m",
        [
            Output("o1", ParamFun(per_sample, map_over_batch=True)(x.sw(3))),
            Output("o2", ParamFun(per_sample, map_over_batch=True)(z.last())),
        ],
    )


@model
def own_fields(m):
    x = Input("x")
    m.addModel("m", [Output("x_next", RK4(ParamFun(polynomial))(x.last()) * 0.1)])
    m.addClosedLoop("x_next", "x")


def imports_inside(x, k):
    import math as m

    import torch.nn.functional as F  # noqa: N812
    from torch import tanh

    return F.softplus(x) * m.pi + k * tanh(x)


def two_tables(x, a, y, b):
    return x * a[1, 0] + y * b[0, 1] + a[0, 0]


@model
def functions_with_imports(m):
    x = Input("x")
    m.addModel("m", [Output("y", ParamFun(imports_inside)(x.sw(2)))])


@model
def matrices_as_operands(m):
    x, y = Input("x"), Input("y")
    a = Parameter("a", dimensions=[2, 1], values=[[0.5], [-2.0]])
    b = Constant("b", values=[[1.5, 3.0]])
    m.addModel("m", [Output("o", ParamFun(two_tables)(x.last(), a, y.last(), b))])


@model
def only_trained(m):
    x, target = Input("x"), Input("target")
    m.addMinimize("fit", target.next(), Fir(x.sw(3)) + Linear(x.last()))

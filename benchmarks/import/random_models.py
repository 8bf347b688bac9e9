"""Draws models of nnodely at random: relations of all kinds, functions with drawn formulas."""

from __future__ import annotations

import linecache
import random
from collections.abc import Callable
from typing import Any

import torch
from layer_models import MODELS
from nnodely import *  # noqa: F403

# ruff: noqa: F405, S311, S102

COUNT = 300
_UNARY = [Sin, Cos, Tanh, Sech, Relu, ELU, Sigmoid, Identity, Sign]
_CALLED = ["torch.sin", "torch.cos", "torch.tanh", "torch.abs", "torch.sigmoid", "torch.relu"]


class Draw:
    """The streams of a random model while it is drawn, by their number of samples and elements."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.inputs = [Input(f"x{i}") for i in range(self.random.randint(1, 3))]
        self.vectors = [Input(f"v{i}", dimensions=self.random.randint(2, 4)) for i in range(2)]
        self.streams: list[Any] = []
        for _ in range(4):
            self.streams.append(self.window(self.random.choice(self.inputs)))
        self.streams.append(self.random.choice(self.vectors).last())
        self.streams.append(self.random.choice(self.vectors).sw(self.random.randint(1, 3)))

    def window(self, signal: Any) -> Any:
        """A random window of an input."""
        n = self.random.randint(1, 5)
        last = self.random.choice([0, 0, 0, 1, -1])
        match self.random.randint(0, 5):
            case 0:
                return signal.last()
            case 1:
                return signal.z(self.random.randint(0, 3))
            case 2:
                return signal.sw([last - n, last], offset=last - n)
            case _:
                return signal.sw([last - n, last])

    def any(self, **wanted: int) -> Any | None:
        """A random stream of these sizes; None if there is none."""
        found = [s for s in self.streams if all(s.dim.get(k) == v for k, v in wanted.items())]
        return self.random.choice(found) if found else None

    def grow(self) -> None:
        """Adds one random relation."""
        stream = self.random.choice(self.streams)
        made = self.random.choice(_STEPS)(self, stream)
        if made is not None:
            self.streams.append(made)


def _unary(draw: Draw, stream: Any) -> Any:
    return draw.random.choice(_UNARY)(stream)


def _binary(draw: Draw, stream: Any) -> Any:
    other = draw.any(sw=stream.dim["sw"], dim=stream.dim["dim"])
    match draw.random.randint(0, 5):
        case 0:
            return stream + other
        case 1:
            return stream - other
        case 2:
            return stream * other
        case 3:
            return stream / (other * other + 2.0)
        case 4:
            return draw.random.uniform(-2, 2) - stream * other
        case _:
            return (stream * stream + 0.5) ** draw.random.choice([2, 3, 0.5, 1.5])


def _with_parameter(draw: Draw, stream: Any) -> Any:
    size, window = stream.dim["dim"], stream.dim["sw"]
    name = f"p{draw.random.randint(0, 10**9)}"
    values = [draw.random.uniform(-1, 1) for _ in range(size)]
    match draw.random.randint(0, 2):
        case 0:
            return stream * Parameter(name, dimensions=1, values=[0.5])
        case 1:
            rows = [[draw.random.uniform(-1, 1) for _ in range(size)] for _ in range(window)]
            return stream + Parameter(name, sw=window, values=rows)
        case _:
            return stream * Constant(name, sw=1, values=[values]) if window == 1 else None


def _filter(draw: Draw, stream: Any) -> Any:
    if stream.dim["dim"] != 1:
        return None
    return Fir(draw.random.randint(1, 3), b=draw.random.random() < 0.5)(stream)


def _linear(draw: Draw, stream: Any) -> Any:
    return Linear(draw.random.randint(1, 4), b=draw.random.random() < 0.5)(stream)


def _sets(draw: Draw, stream: Any) -> Any:
    if stream.dim["dim"] != 1:
        return None
    kind = draw.random.choice(["Triangular", "Rectangular"])
    count = draw.random.randint(2, 5)
    if draw.random.random() < 0.5:
        return Fuzzify(count, [-1, draw.random.randint(1, 2)], functions=kind)(stream)
    centers = sorted(draw.random.uniform(-1, 1) for _ in range(count))
    return Fuzzify(centers=centers, functions=kind)(stream)


def _part(draw: Draw, stream: Any) -> Any:
    size, window = stream.dim["dim"], stream.dim["sw"]
    if size > 1 and draw.random.random() < 0.6:
        first = draw.random.randint(0, size - 2)
        whole = Part(stream, first, draw.random.randint(first + 1, size))
        return draw.random.choice(
            [whole, Select(stream, first), Sum(stream * 1.0), Softmax(stream)]
        )
    if window > 1:
        first = draw.random.randint(0, window - 2)
        last = draw.random.randint(first + 1, window)
        offset = draw.random.choice([None, first])
        return draw.random.choice(
            [SamplePart(stream, first, last, offset), SampleSelect(stream, first)]
        )
    return None


def _join(draw: Draw, stream: Any) -> Any:
    if draw.random.random() < 0.5:
        other = draw.any(sw=stream.dim["sw"])
        return Concatenate(stream, other) if stream.dim["dim"] + other.dim["dim"] < 8 else None
    other = draw.any(dim=stream.dim["dim"])
    return TimeConcatenate(stream, other) if stream.dim["sw"] + other.dim["sw"] < 9 else None


def _history(draw: Draw, stream: Any) -> Any:
    match draw.random.randint(0, 3):
        case 0:
            return stream.sw(draw.random.randint(1, 4))
        case 1:
            return stream.z(draw.random.randint(1, 3))
        case _:
            first = draw.random.randint(2, 4)
            return stream.sw([-first, -draw.random.randint(0, first - 1)])


def _calculus(draw: Draw, stream: Any) -> Any:
    if stream.dim["sw"] != 1:
        return None
    method = draw.random.choice(["euler", "trapezoidal"])
    return draw.random.choice([Integrate, Differentiate])(stream, method=method)


def _local(draw: Draw, stream: Any) -> Any:
    if stream.dim["dim"] != 1:
        return None
    single = draw.any(sw=1, dim=1)
    if single is None:
        return None
    sets = Fuzzify(draw.random.randint(2, 3), [-1, 1])(single)
    other = Fuzzify(draw.random.randint(2, 3), [-1, 2])(draw.any(sw=1, dim=1))
    both = draw.random.choice([sets, (sets, other)])
    bias = draw.random.random() < 0.5
    if stream.dim["sw"] == 1 and draw.random.random() < 0.4:
        out = draw.random.randint(1, 2)
        return LocalModel(output_function=lambda: Fir(out))(stream, both)
    return LocalModel(input_function=lambda: Fir(b=bias))(stream, both)


def _learner(draw: Draw, stream: Any) -> Any:
    chosen = draw.random.sample([Sin, Tanh, Add, Mul, Sub, Identity, Neg, Sech], 3)
    last = Linear(2, b=True) if draw.random.random() < 0.5 else None
    return EquationLearner(chosen, linear_out=last)(stream)


def _table(draw: Draw, stream: Any) -> Any:
    if stream.dim["sw"] != 1 or stream.dim["dim"] != 1:
        return None
    knots = sorted(draw.random.uniform(-2, 2) for _ in range(draw.random.randint(2, 6)))
    return Interpolation(knots, [draw.random.uniform(-1, 1) for _ in knots])(stream)


def _formula(draw: Draw, names: list[str], depth: int) -> str:
    if depth == 0:
        return draw.random.choice([*names, *names, f"{draw.random.uniform(-2, 2):.3g}"])
    left = _formula(draw, names, depth - 1)
    match draw.random.randint(0, 6):
        case 0 | 1:
            return f"{draw.random.choice(_CALLED)}({_formula(draw, names, depth - 1)} + {names[0]})"
        case 2:
            return f"torch.clamp({left} * {names[0]}, -1.0, 1.5)"
        case 3:
            return f"torch.where({names[0]} > 0.1003, {left} + {names[0]}, {names[0]})"
        case 4:
            return f"({left} - {_formula(draw, names, depth - 1)})"
        case _:
            return f"({left}) * ({_formula(draw, names, depth - 1)})"


def _function(draw: Draw, stream: Any) -> Any:
    other = draw.any(sw=stream.dim["sw"], dim=stream.dim["dim"])
    name = f"f{draw.random.randint(0, 10**9)}"
    body = _formula(draw, ["a", "b", "k", "c"], draw.random.randint(1, 4))
    forms = [
        f"    return {body} + 0 * a\n",
        f"    y = {body}\n    y = y + 0 * a\n    return torch.tanh(y) * y\n",
        f"    y = {body} + 0 * a\n    return torch.cat((y, a), dim=2)\n",
        f"    y = {body} + 0 * b\n    return y[:, -1:, :]\n",
        f"    y = a + 0 * {body}\n    return torch.sum(y * b, dim=2, keepdim=True)\n",
        f"    y = {body} + 0 * a\n    for i in range(2):\n        y = y.sin() * k\n    return y\n",
    ]
    code = f"def {name}(a, b, k, c):\n{draw.random.choice(forms)}"
    file = f"<{name}>"
    linecache.cache[file] = (len(code), None, code.splitlines(keepends=True), file)
    space: dict[str, Any] = {"torch": torch}
    exec(compile(code, file, "exec"), space)
    return ParamFun(space[name])(stream, other)


_STEPS: list[Callable[[Draw, Any], Any]] = [
    _unary,
    _binary,
    _binary,
    _with_parameter,
    _filter,
    _filter,
    _linear,
    _sets,
    _part,
    _part,
    _join,
    _history,
    _calculus,
    _local,
    _learner,
    _table,
    _function,
    _function,
]


def random_model(seed: int) -> Callable[[Any], None]:
    """The builder of one drawn model."""

    def build(m: Any) -> None:
        draw = Draw(seed)
        count = draw.random.randint(5, 25)
        while len(draw.streams) < count + 6:
            draw.grow()
        outputs = [Output(f"o{i}", Tanh(s)) for i, s in enumerate(draw.streams[-3:])]
        closing = draw.any(dim=1, sw=1)
        loops = draw.random.random()
        if loops < 0.35 and closing is not None:
            state = Input("state")
            fed = Fir(state.sw(draw.random.randint(1, 3))) * 0.5 + Tanh(closing)
            outputs.append(Output("state_next", fed))
            m.addModel("m", outputs)
            m.addClosedLoop("state_next", "state")
        elif loops < 0.6 and closing is not None:
            line = Input("line")
            outputs.append(Output("far", Fir(line.sw(draw.random.randint(1, 4)))))
            outputs.append(Output("near", Sin(closing)))
            m.addModel("m", outputs)
            m.addConnect("near", "line")
        else:
            m.addModel("m", outputs)

    return build


MODELS.update({f"random_{seed:03d}": random_model(seed) for seed in range(COUNT)})

"""Writes the reference model by hand for CasADi and for ONNX, as small as possible, with the same
values.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from compiler.ir.program import Program

_CENTERS = np.linspace(-45.0, 45.0, 7)
_WIDTH = 15.0
_STEP = 0.05


def casadi_step(program: Program) -> casadi.Function:
    """A function of u, v and 24 old samples that returns the speed (as output and state) and the
    next samples.
    """
    values = _values(program)
    u, v, h = (casadi.SX.sym(name, n) for name, n in (("u", 1), ("v", 1), ("h", 24)))
    window = casadi.vertcat(h, u)
    command = casadi.dot(values["command.weight"], window)
    inside = casadi.fmin(casadi.fmax(v, _CENTERS[0]), _CENTERS[-1])
    degrees = casadi.fmax(0, 1 - casadi.fabs(inside - _CENTERS) / _WIDTH)
    gain = casadi.dot(degrees, values["gain.weight"] * command + values["gain.bias"])
    drag = float(values["p0"][0]) * casadi.tanh(values["p1"][0] * v + values["p2"][0])
    following = v + _STEP * (gain + drag)
    return casadi.Function("step", [u, v, h], [following, following, window[1:]])


def write_onnx_step(program: Program, path: Path) -> Path:
    """Writes a step with the same ports as an ONNX model of 20 nodes."""
    values = {name: array.astype(np.float32) for name, array in _values(program).items()}
    numbers = {
        "W": values["command.weight"],
        "c": _CENTERS.astype(np.float32),
        "low": np.float32(_CENTERS[0]),
        "high": np.float32(_CENTERS[-1]),
        "slope": np.array([-1.0 / _WIDTH], np.float32),
        "one": np.array([1.0], np.float32),
        "gw": values["gain.weight"],
        "gb": values["gain.bias"],
        "p0": values["p0"],
        "p1": values["p1"],
        "p2": values["p2"],
        "dt": np.array([_STEP], np.float32),
        "axis": np.array([0]),
        "first": np.array([1]),
        "end": np.array([25]),
    }
    nodes = [
        helper.make_node("Concat", ["h", "u"], ["w"], axis=0),
        *_nodes("Mul W w -> Ww; ReduceSum Ww axis -> f; Clip v low high -> x; Sub x c -> d"),
        *_nodes("Abs d -> a; Mul a slope -> b; Add b one -> m; Relu m -> mu; Mul gw f -> g"),
        *_nodes("Add g gb -> r; Mul mu r -> mr; ReduceSum mr axis -> gain; Mul p1 v -> q"),
        *_nodes("Add q p2 -> q2; Tanh q2 -> th; Mul p0 th -> drag; Add gain drag -> acc"),
        *_nodes("Mul dt acc -> dv; Add v dv -> y; Identity y -> vn; Slice w first end -> hn"),
    ]
    graph = helper.make_graph(
        nodes,
        "reference",
        [_port("u", 1), _port("v", 1), _port("h", 24)],
        [_port("y", 1), _port("vn", 1), _port("hn", 24)],
        [numpy_helper.from_array(np.asarray(array), name) for name, array in numbers.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True)
    onnx.save(model, str(path))
    return path


def _values(program: Program) -> dict[str, NDArray[np.float64]]:
    return {parameter.name: np.array(parameter.initial) for parameter in program.parameters}


def _nodes(text: str) -> Sequence[onnx.NodeProto]:
    """ONNX nodes from a text `Op operand operand -> result; …`."""
    made: list[onnx.NodeProto] = []
    for part in text.split("; "):
        head, result = part.split(" -> ")
        op, *operands = head.split()
        made.append(helper.make_node(op, operands, [result]))
    return made


def _port(name: str, size: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [size])

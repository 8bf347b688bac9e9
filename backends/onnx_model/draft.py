"""Prepares a program for ONNX: the shared parts of its models and declarations of ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
from numpy.typing import ArrayLike, DTypeLike, NDArray
from onnx import TensorProto, helper

from backends.onnx_model.lowering import LeafNodes, OnnxNodes, lower_nodes
from backends.ports.metadata import interface_metadata, metadata_text
from backends.ports.step_interface import PortNames, StepInterface, port_names, step_interface
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Parameter, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Axis
from compiler.passes.expand_functions import expand_functions
from spec_schema.units.unit import Unit
from spec_schema.version import __version__

OPSET = 17
"""Operator set, which most current runtimes support; no newer operators are needed."""

IR_VERSION = 8
"""The version of the file format for this operator set."""

NATIVE = frozenset(name for name, row in SCALAR_FUNCTIONS.items() if row.onnx)
"""Scalar functions with an exact double operator; others are lowered by definition."""

STEPS = "steps"
"""Name of the free dimension of a rollout, and of the input of a rollout without inputs."""

Values = list[onnx.ValueInfoProto]

_ELEMENTS = {
    np.dtype(np.float32): TensorProto.FLOAT,
    np.dtype(np.float64): TensorProto.DOUBLE,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """A program prepared for ONNX: functions that ONNX lacks are expanded. `names` are the names of
    its ports, `weights` physical arrays by name, `dtype` the precision of the models.
    """

    program: Program
    interface: StepInterface
    names: PortNames
    weights: Mapping[str, NDArray[np.float64]]
    dtype: np.dtype[Any]

    @staticmethod
    def of(program: Program, weights: Mapping[str, ArrayLike] | None, dtype: DTypeLike) -> Draft:
        """Prepares a program in step form. `weights` are physical arrays by name; a missing one, or
        None, means initial values. Raises ValueError for a program in window form, a dtype other
        than float32 and float64, or a weight of a wrong shape.
        """
        real = np.dtype(dtype)
        if real not in _ELEMENTS:
            message = f"an ONNX model is made in float32 or float64, not {real}"
            raise ValueError(message)
        # expansion does not change names and shapes of parameters
        arrays = physical_weights(program, weights or {})
        expanded = expand_functions(program, NATIVE)
        interface = step_interface(expanded)
        return Draft(
            program=expanded,
            interface=interface,
            names=port_names(interface, (STEPS,)),
            weights=arrays,
            dtype=real,
        )

    def nodes(self) -> OnnxNodes:
        """A new empty list of ONNX nodes, in which the names of ports are taken."""
        names = self.names
        tables = (
            names.inputs,
            names.states,
            names.parameters,
            names.outputs,
            names.next_states,
            names.start_windows,
        )
        return OnnxNodes(self.dtype, {STEPS, *(n for table in tables for n in table.values())})

    def lower_step(self, nodes: OnnxNodes, names: PortNames) -> None:
        """Adds the ONNX nodes of the step to `nodes`. Its inputs, states, outputs and next states
        have the names in `names`.
        """
        ports = {p.signal.name: (p, names.inputs[p.signal.name]) for p in self.interface.inputs}
        sources = LeafNodes(ports, names.states, names.parameters, self.weights)
        values = lower_nodes(self.program.step, self.interface.step_nodes, sources, nodes)
        for output in self.interface.outputs:
            # an output may equal an input or another output, but ONNX needs unique names
            nodes.add_as(names.outputs[output.name], "Identity", [values[output.node]])
        for state in self.interface.states:
            nodes.add_as(names.next_states[state.name], "Identity", [values[state.next]])

    def inputs(self, names: PortNames, *, series: bool = False) -> Values:
        return [
            self.value(
                names.inputs[port.signal.name],
                port.type.axes,
                _doc(port.signal.doc, port.signal.unit, port.lag),
                series=series,
            )
            for port in self.interface.inputs
        ]

    def outputs(self, names: PortNames, *, series: bool = False) -> Values:
        types = {
            output.name: self.program.step[output.node].type for output in self.program.outputs
        }
        return [
            self.value(
                names.outputs[output.name],
                types[output.name].axes,
                _doc(output.doc, types[output.name].unit),
                series=series,
            )
            for output in self.interface.outputs
        ]

    def states(self, names: Mapping[str, str]) -> Values:
        return [
            self.value(names[state.name], state.axes, _doc(state.doc, state.unit))
            for state in self.interface.states
        ]

    def start_windows(self) -> Values:
        return [
            self.value(
                self.names.start_windows[port.signal.name],
                port.type.axes,
                _doc(f"samples {port.first} … {port.last} around the start", port.signal.unit),
            )
            for port in self.interface.start_windows
        ]

    def value(
        self, name: str, axes: Sequence[Axis], doc: str, *, series: bool = False
    ) -> onnx.ValueInfoProto:
        """The declaration of an ONNX value: name, shape and documentation; each dimension has the
        name of its axis as denotation. With `series` the free dimension `steps` comes first.
        """
        shape: list[int | str] = [axis.size for axis in axes]
        names = [axis.name for axis in axes]
        if series:
            # a string is a free dimension, so that one model runs logs of any length
            shape, names = [STEPS, *shape], [STEPS, *names]
        declared = helper.make_tensor_value_info(name, _ELEMENTS[self.dtype], shape, doc)
        # ONNX has no axis names; tools show denotations
        for dimension, axis in zip(declared.type.tensor_type.shape.dim, names, strict=True):
            dimension.denotation = axis
        return declared

    def model(
        self,
        kind: str,
        nodes: OnnxNodes,
        arguments: Values,
        results: Values,
        parameters: Sequence[Parameter],
    ) -> onnx.ModelProto:
        """The ONNX model of these nodes, arguments and results. Parameters become initialisers; the
        metadata has the names and units of all ports. `kind` is the name of the graph. Raises
        onnx.checker.ValidationError if the model is invalid, which would be a bug.
        """
        for parameter in parameters:
            name = self.names.parameters[parameter.name]
            nodes.numbers(name, self.weights[parameter.name], _doc(parameter.doc, parameter.unit))
        graph = helper.make_graph(
            nodes.nodes, kind, arguments, results, nodes.initializers, self.program.doc
        )
        model = helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="msnn",
            producer_version=__version__,
            doc_string=self.program.doc,
        )
        metadata = interface_metadata(self.program, self.interface, self.names, self.weights)
        properties = {
            "model": self.program.name,
            "kind": kind,
            "sample_time": str(self.program.sample_time),
            "spec_sha256": self.program.spec_hash,
            "interface": metadata_text(metadata),
        }
        helper.set_model_props(model, properties)
        # also infers shapes, so that errors are found here, not by a runtime
        onnx.checker.check_model(model, full_check=True)
        return model


def _doc(doc: str, unit: Unit | None, lag: int = 0) -> str:
    """The documentation of a value with its unit, and its delay of `lag` samples: `Force on the
    mass [N], 2 samples late`.
    """
    text = f"{doc} [{unit.text}]".strip() if unit else doc
    return f"{text}, {lag} samples late" if lag else text

"""Collects the nodes and constants of an ONNX graph, with unique names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from backends.ports.identifiers import c_identifier
from compiler.ir.types import Type


class OnnxNodes:
    """Lists of nodes and initialisers under construction. Methods take and return value names."""

    def __init__(self, dtype: np.dtype[Any], taken: set[str]) -> None:
        self.dtype = dtype
        self.taken = taken
        """Used names, including those of ports."""
        self.nodes: list[onnx.NodeProto] = []
        self.initializers: list[onnx.TensorProto] = []
        self._shapes: dict[tuple[int, ...], str] = {}
        self._label = "value"
        self._doc = ""

    def describe(self, label: str, doc: str) -> None:
        """Sets the name prefix and the doc of the following nodes."""
        self._label = label
        self._doc = doc

    def add(self, operator: str, inputs: Sequence[str], **attributes: Any) -> str:
        """Adds a node with one result; returns its name."""
        result = c_identifier(self._label, self.taken)
        self.add_as(result, operator, inputs, **attributes)
        return result

    def add_as(self, result: str, operator: str, inputs: Sequence[str], **attributes: Any) -> None:
        """Adds a node whose result has a name that is already reserved."""
        node = helper.make_node(operator, inputs, [result], name=result, **attributes)
        node.doc_string = self._doc
        self.nodes.append(node)

    def numbers(self, name: str, values: NDArray[np.float64], doc: str = "") -> str:
        """Adds an initialiser in the model's precision, under a reserved name."""
        with np.errstate(over="ignore"):  # a bound beyond float32 becomes infinite
            array = np.asarray(values, dtype=self.dtype)
        tensor = numpy_helper.from_array(array, name)
        tensor.doc_string = doc
        self.initializers.append(tensor)
        return name

    def constant(self, values: NDArray[np.float64]) -> str:
        return self.numbers(c_identifier(self._label, self.taken), values)

    def integers(self, values: Iterable[int]) -> str:
        """A vector of 64-bit integers, for shapes and indices; equal ones are shared."""
        key = tuple(values)
        # shapes are operands in ONNX: equal ones share an initialiser
        if key not in self._shapes:
            name = c_identifier("shape_" + "_".join(map(str, key)), self.taken)
            self.initializers.append(numpy_helper.from_array(np.array(key, np.int64), name))
            self._shapes[key] = name
        return self._shapes[key]

    # ---- changes of axes that are left out where they change nothing

    def transposed(self, value: str, order: Sequence[int]) -> str:
        if list(order) == sorted(order):
            return value
        return self.add("Transpose", [value], perm=list(order))

    def reshaped(self, value: str, before: tuple[int, ...], after: tuple[int, ...]) -> str:
        if before == after:
            return value
        return self.add("Reshape", [value, self.integers(after)])

    def sliced(self, value: str, axis: int, start: int, stop: int) -> str:
        bounds = [self.integers([number]) for number in (start, stop, axis)]
        return self.add("Slice", [value, *bounds])

    def broadcast(self, value: str, operand: Type, result: Type) -> str:
        """The operand repeated along missing axes, with axes in the order of the result."""
        names = [axis.name for axis in result.axes if axis.name in operand.axis_names]
        value = self.transposed(value, [operand.position(name) for name in names])
        missing = [i for i, axis in enumerate(result.axes) if axis.name not in names]
        if not missing:
            return value
        # a scalar expands to any shape; other values first need their missing axes
        if names:
            value = self.add("Unsqueeze", [value, self.integers(missing)])
        return self.add("Expand", [value, self.integers(result.shape)])

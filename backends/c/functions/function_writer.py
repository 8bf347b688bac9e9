"""Begins every function of a controller: its block, its names, where values are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Field, Interface
from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView
from backends.c_language.scope import BlockScope, LocalNames, SpecName
from backends.c_language.tree import Argument, Comment, Discard, Function, Name, Statement
from backends.c_lowering.local_values import LocalValues
from backends.c_lowering.spec_notes import SpecNotes
from backends.c_lowering.state_memory import Buffer, DelayLine, PlainState
from compiler.ir import ops
from compiler.ir.program import Formula, Graph
from compiler.ir.types import Type

_BLOCK = 6
"""Terms of a long sum in one turn of its loop: more save little and cost flash."""

_FEWEST_WRITTEN_OUT = 4
"""A smaller `unroll` asks for small code: its turns have no more terms than that."""

Weights = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class ControllerCode:
    """The interface, weights and functions that all functions of one controller share."""

    interface: Interface
    weights: Weights
    functions: FunctionTable
    formulas: tuple[Formula, ...] = ()


class FunctionWriter:
    """One function while it is being written; also where its graph finds its leaves."""

    def __init__(self, model: ControllerCode, graph: Graph) -> None:
        self.model = model
        self.interface = model.interface
        self.unroll = model.interface.options.unroll
        self.scope = BlockScope(LocalNames(model.interface.prefix, _names_of_spec(graph)))
        block = _BLOCK if self.unroll >= _FEWEST_WRITTEN_OUT else self.unroll
        self.locals = LocalValues(
            model.functions,
            SpecNotes(graph, model.formulas),
            self.unroll,
            block=block,
            names_constants=True,
        )
        self.inputs: dict[str, ArrayView] = {}
        """Where the step finds its checked inputs."""
        self.checked_windows: dict[str, ArrayView] = {}
        """Where the start finds samples around t0 that were checked."""
        self._reads_parameters = False
        self._memory = {memory.state.name: memory for memory in self.interface.states}
        self._windows = {field.name: (field, port) for field, port in self.interface.windows}
        self._parameters = {field.name: field for field in self.interface.parameters}

    def read(self, op: ops.AnyRead, type: Type) -> ArrayView:
        match op:
            case ops.ReadParameter(name):
                return self._parameter(self._parameters[name], type)
            case ops.ReadSignal(name):
                return self.inputs[name]
            case ops.ReadState(name):
                return self._memory[name].samples
            case ops.ReadLog(name, first, last):
                return self._window(name, first, last, type)
            # seeds of the reverse graph: `native/` alone has them, and lowers them by its own
            # reader
            case ops.ReadTraining():
                raise AssertionError("no program reads values of training")
            case _:
                assert_never(op)

    def push(self, op: ops.Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        memory = self._memory[op.state]
        # these do not hold the newest sample beside the others: the window is made elsewhere
        if isinstance(memory, PlainState | DelayLine):
            return None
        self.before_push(memory, newest)
        memory.push(newest, scope, self.unroll)
        return memory.window

    def before_push(self, memory: Buffer, newest: ArrayView) -> None:
        """Writes what comes before a buffer takes its newest sample; nothing, if not overridden."""

    def instance(self) -> tuple[Name, ...]:
        """The arguments of a function of this instance alone."""
        if not self.interface.takes_parameters:
            return (Name("s"),)
        self._reads_parameters = True
        return Name("s"), Name("p")

    def comment(self, text: str) -> None:
        self.scope.add(Comment(text))

    def finished(
        self,
        name: str,
        result: str,
        structs: tuple[Argument, ...],
        doc: str,
        *,
        reads_only: bool = False,
    ) -> Function:
        """The function with what has been written; `structs` come after state and parameters.

        One that `reads_only` takes a state that it cannot change.
        """
        prefix = self.interface.prefix
        # of every function, one without states too: callers are written once for all models
        arguments = [Argument(f"{'const ' if reads_only else ''}{prefix}_state_t *", "s")]
        unused: list[Statement] = []
        if self.interface.takes_parameters:
            arguments.append(Argument(f"const {prefix.upper()}_PLACED {prefix}_params_t *", "p"))
            # all functions of an instance take the same arguments, used or not
            unused += [] if self._reads_parameters else [Discard("p")]
        statements = self.scope.statements
        body = (*unused, *self.locals.constants(statements), *statements)
        return Function(
            name=f"{prefix}_{name}",
            result=result,
            arguments=(*arguments, *structs),
            body=body,
            doc=doc,
        )

    def _parameter(self, field: Field, type: Type) -> ArrayView:
        if self.interface.takes_parameters:
            self._reads_parameters = True
            return field.place("p")
        values = tuple(float(value) for value in self.model.weights[field.name].ravel())
        return self.locals.known(values, type, SpecName(field.name), self.scope)

    def _window(self, name: str, first: int, last: int, type: Type) -> ArrayView:
        field, port = self._windows[name]
        samples = self.checked_windows.get(name, field.place("x0")).reshaped(port.type.shape)
        assert samples is not None  # at most an axis of length 1 is added
        axis = len(port.type.shape) - 1
        # sample `first` of the log is at `first - port.first` in the array, whose oldest is 0
        part = samples.sliced(axis, first - port.first, last - port.first + 1)
        read = part.reshaped(type.shape)
        assert read is not None
        return read


def _names_of_spec(graph: Graph) -> Iterator[str]:
    """The names that the spec has for values and numbers of a graph."""
    for node in graph.nodes:
        if node.label:
            yield node.label
        if isinstance(node.op, ops.ReadParameter) or (
            isinstance(node.op, ops.Constant) and node.op.name
        ):
            yield node.op.name

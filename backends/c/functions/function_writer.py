"""Base class of the writers of C functions: statements, names of variables, and C places of the
values that a graph reads.
"""

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
from backends.c_lowering.spec_notes import SpecNotes
from backends.c_lowering.state_memory import Buffer, DelayLine, PlainState
from backends.c_lowering.values import LocalValues
from compiler.ir import ops
from compiler.ir.program import Formula, Graph
from compiler.ir.types import Type

_BLOCK = 6
"""Terms of a long sum per iteration of its loop: more terms save little time and cost flash."""

_FEWEST_WRITTEN_OUT = 4
"""A smaller `unroll` requests small code, so that loops also have at most that many terms."""

Weights = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class ControllerCode:
    """The data that all functions of one controller share: interface, weights (physical arrays by
    name), table of helper functions, and formulas of the spec for comments.
    """

    interface: Interface
    weights: Weights
    functions: FunctionTable
    formulas: tuple[Formula, ...] = ()


class FunctionWriter:
    """Base class of the writers of one C function each: collects statements in `scope`, and gives
    the C places of the signals, states and parameters that the graph reads.
    """

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
        """Places of the checked inputs of the step."""
        self.checked_windows: dict[str, ArrayView] = {}
        """Places of the checked samples around t0, for the start."""
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
            # only the training kernels of `native/` have these, with a reader of their own
            case ops.ReadTraining():
                raise AssertionError("no program reads values of training")
            case _:
                assert_never(op)

    def push(self, op: ops.Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        memory = self._memory[op.state]
        # these do not store the newest sample with the others: the window is built elsewhere
        if isinstance(memory, PlainState | DelayLine):
            return None
        self.before_push(memory, newest)
        memory.push(newest, scope, self.unroll)
        return memory.window

    def before_push(self, memory: Buffer, newest: ArrayView) -> None:
        """Hook for subclasses: may write statements before `newest`, the sample at t, enters a
        buffer.
        """

    def instance(self) -> tuple[Name, ...]:
        """The C arguments `s` and, if functions take parameters, `p`."""
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
        """The C function `<prefix>_<name>` with the statements so far. `result` is its return type;
        `structs` are its arguments after state and parameters; `doc` is its comment. With
        `reads_only` the state argument is const.
        """
        prefix = self.interface.prefix
        # also without states, so that callers are the same for all models
        arguments = [Argument(f"{'const ' if reads_only else ''}{prefix}_state_t *", "s")]
        unused: list[Statement] = []
        if self.interface.takes_parameters:
            arguments.append(Argument(f"const {prefix.upper()}_PLACED {prefix}_params_t *", "p"))
            # all functions of an instance have the same arguments, even if unused
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
        assert samples is not None  # only adds an axis of length 1
        axis = len(port.type.shape) - 1
        # sample `first` of the log is at `first - port.first` in the array, whose oldest is 0
        part = samples.sliced(axis, first - port.first, last - port.first + 1)
        read = part.reshaped(type.shape)
        assert read is not None
        return read


def _names_of_spec(graph: Graph) -> Iterator[str]:
    """The names that the spec gives to values and constants of a graph."""
    for node in graph.nodes:
        if node.label:
            yield node.label
        if isinstance(node.op, ops.ReadParameter) or (
            isinstance(node.op, ops.Constant) and node.op.name
        ):
            yield node.op.name

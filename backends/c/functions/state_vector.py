"""Functions that copy the structs of a step into the vectors of its Jacobian and back."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from backends.c.functions.state_reports import BUFFERS_EMPTY, INITIALISED, STATES_UNSET
from backends.c.interface.interface import Field, Interface
from backends.c.interface.jacobian_interface import JacobianInterface, VectorNames
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import Argument, Assign, Binary, Function, Member, Unsigned
from backends.c_lowering.state_memory import DelayLine, PlainState, StateMemory
from backends.c_lowering.values import copy_value

_VECTOR = "v"


def vector_functions(interface: Interface, jacobian: JacobianInterface) -> list[Function]:
    """C functions that copy between structs and vectors of the Jacobian: `get_state`, `get_inputs`,
    `get_outputs`, `get_parameters` for nonempty vectors, and `set_state`, `set_parameters`.
    """
    functions: list[Function] = []
    for vector in jacobian.vectors:
        match vector.letter:
            case "x":
                functions += [_get_state(interface, vector), _set_state(interface, vector)]
            case "u":
                fields = [i.field for i in interface.inputs if vector.has(i.field.name)]
                functions.append(_get(interface, vector, "in", "inputs", fields))
            case "y":
                functions.append(_get(interface, vector, "out", "outputs", interface.outputs))
            case "p":
                fields = [f for f in interface.parameters if vector.has(f.name)]
                functions += [
                    _get(interface, vector, "params", "parameters", fields),
                    _set_parameters(interface, vector, fields),
                ]
            case _:
                pass
    return functions


def _get_state(interface: Interface, vector: VectorNames) -> Function:
    def write(scope: BlockScope) -> None:
        listed = _listed(interface, vector)
        for memory in listed:
            # rings: the head must be read before the samples
            if not isinstance(memory, PlainState | DelayLine):
                memory.begin(scope)
        for memory in listed:
            target = vector.place(_VECTOR, memory.state.name, memory.shape)
            copy_value(memory.samples, target, scope, interface.options.unroll)

    doc = f"Copies {_all_of(interface)} into a vector x."
    return _function(interface, "get_state", ("const ", "state", "s"), doc, write)


def _set_state(interface: Interface, vector: VectorNames) -> Function:
    def write(scope: BlockScope) -> None:
        listed = _listed(interface, vector)
        for memory in listed:
            source = vector.place(_VECTOR, memory.state.name, memory.shape)
            memory.write_start(source, scope, interface.options.unroll)
        if interface.from_record:  # the states are no longer unset
            # only clears bits: setting a vector does not replace `init`
            ready = Member("s", interface.ready)
            scope.add(Assign(ready, Binary("&", ready, Unsigned(_waiting(interface, listed)))))

    doc = (
        f"Replaces {_all_of(interface)} by a vector x, as a filter that corrects it does; "
        "init or reset come before."
    )
    return _function(interface, "set_state", ("", "state", "s"), doc, write)


def _listed(interface: Interface, vector: VectorNames) -> list[StateMemory]:
    return [memory for memory in interface.states if vector.has(memory.state.name)]


def _waiting(interface: Interface, listed: Iterable[StateMemory]) -> int:
    """The bits of the field `ready` that may remain set after the states in `listed` were set:
    INITIALISED, and the bits for other states that still wait for data.
    """
    rest = interface.from_record - {memory.state.name for memory in listed}
    kept = INITIALISED | (BUFFERS_EMPTY if rest & interface.filled_by_first else 0)
    return kept | (STATES_UNSET if rest - interface.filled_by_first else 0)


def _all_of(interface: Interface) -> str:
    declared_only = "state_jacobian" in interface.options.extras
    return "the declared states" if declared_only else "all that is remembered"


def _get(
    interface: Interface, vector: VectorNames, struct: str, what: str, fields: Iterable[Field]
) -> Function:
    base = {"in": "u", "out": "y", "params": "p"}[struct]

    def write(scope: BlockScope) -> None:
        for field in fields:
            target = vector.place(_VECTOR, field.name, field.shape)
            copy_value(field.place(base), target, scope, interface.options.unroll)

    doc = f"Copies {what} of a step into a vector {base}."
    return _function(interface, f"get_{what}", ("const ", struct, base), doc, write)


def _set_parameters(interface: Interface, vector: VectorNames, fields: Iterable[Field]) -> Function:
    def write(scope: BlockScope) -> None:
        for field in fields:
            source = vector.place(_VECTOR, field.name, field.shape)
            copy_value(source, field.place("p"), scope, interface.options.unroll)

    doc = "Replaces the parameters of a step by a vector p."
    return _function(interface, "set_parameters", ("", "params", "p"), doc, write)


def _function(
    interface: Interface,
    name: str,
    struct: tuple[str, str, str],
    doc: str,
    write: Callable[[BlockScope], None],
) -> Function:
    """The C function `<prefix>_<name>` that copies between a struct and a vector `v`. `struct` is
    (`const ` if the struct is read, else empty; its type; its argument name). `write` adds the
    copying statements to a scope.
    """
    prefix = interface.prefix
    scope = BlockScope(LocalNames(prefix))
    scope.reserve(_VECTOR)
    write(scope)
    # the source is const
    constant, type, base = struct
    arguments = (
        Argument(f"{constant}{prefix}_{type}_t *", base),
        Argument(f"{'' if constant else 'const '}{prefix}_real *", _VECTOR),
    )
    return Function(
        name=f"{prefix}_{name}",
        result="void",
        arguments=arguments,
        body=tuple(scope.statements),
        doc=doc,
    )

"""Compares, in C, what single golden steps leave in the state struct: by a hash of each step."""

from __future__ import annotations

from backends.c.interface.interface import Interface
from backends.c.selftest.golden_singles import GoldenSingles
from backends.c.selftest.matrix_checksums import START, checksums
from backends.c.selftest.vectors.written_states import state_fields
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import (
    Argument,
    Assign,
    Binary,
    Call,
    ConstantTable,
    CType,
    Declare,
    Element,
    Function,
    If,
    Name,
    Return,
    Truth,
    Unsigned,
)

_STATE, _STEP, _HASH = "s", "golden_step", "hash"


def state_function(interface: Interface, singles: GoldenSingles, first: int) -> Function:
    """`<prefix>_state_differs(s, golden_step)`: whether one left other states than it should.

    In a golden run the next steps show what a step remembers; behind a single step stands none, so
    that only those, from step `first` on, are compared.
    """
    prefix, fields = interface.prefix, state_fields(interface)
    scope = BlockScope(LocalNames(prefix))
    for name in (_STEP, _HASH):
        scope.reserve(name)
    scope.add(If(Binary("<", Name(_STEP), Unsigned(first)), (Return(Truth(False)),)))
    hashes = checksums({field.name: singles.vectors.states[field.name] for field in fields})
    scope.add(ConstantTable("golden_hash", tuple(map(float, hashes)), CType.UNSIGNED))
    scope.add(Declare(CType.UNSIGNED, _HASH, Unsigned(START)))
    for field in fields:
        place = field.place(_STATE)

        def add(at: tuple[Index, ...], inner: BlockScope, place: ArrayView = place) -> None:
            called = Call(f"{prefix}_hashed", (Name(_HASH), place.element(at)))
            inner.add(Assign(Name(_HASH), called))

        scope.each(field.shape, interface.options.unroll, add)
    expected = Element(Name("golden_hash"), Binary("-", Name(_STEP), Unsigned(first)))
    scope.add(Return(Binary("!=", Name(_HASH), expected)))
    arguments = (Argument(f"const {prefix}_state_t *", _STATE), Argument("uint32_t", _STEP))
    body = tuple(scope.statements)
    return Function(
        name=f"{prefix}_state_differs", result="bool", arguments=arguments, body=body, static=True
    )

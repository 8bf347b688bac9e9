"""Compares, in C, the states after single golden steps by a hash per step."""

from __future__ import annotations

from backends.c.interface.interface import Interface
from backends.c.selftest.golden_singles import GoldenSingles
from backends.c.selftest.matrix_checksums import START, checksums
from backends.c.selftest.vectors.written_states import state_fields
from backends.c_language import tree as c
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalNames

_STATE, _STEP, _HASH = "s", "golden_step", "hash"


def state_function(interface: Interface, singles: GoldenSingles, first: int) -> c.Function:
    """`<prefix>_state_differs(s, golden_step)`: true if the states after a single step are wrong.

    In a golden run, later steps reveal wrong states. A single step has no later step, so its states
    are compared directly; single steps start at index `first`.
    """
    prefix, fields = interface.prefix, state_fields(interface)
    scope = BlockScope(LocalNames(prefix))
    for name in (_STEP, _HASH):
        scope.reserve(name)
    scope.add(c.If(c.Binary("<", c.Name(_STEP), c.Unsigned(first)), (c.Return(c.Truth(False)),)))
    hashes = checksums({field.name: singles.vectors.states[field.name] for field in fields})
    scope.add(c.ConstantTable("golden_hash", tuple(map(float, hashes)), c.CType.UNSIGNED))
    scope.add(c.Declare(c.CType.UNSIGNED, _HASH, c.Unsigned(START)))
    for field in fields:
        place = field.place(_STATE)

        def add(at: tuple[Index, ...], inner: BlockScope, place: ArrayView = place) -> None:
            called = c.Call(f"{prefix}_hashed", (c.Name(_HASH), place.element(at)))
            inner.add(c.Assign(c.Name(_HASH), called))

        scope.each(field.shape, interface.options.unroll, add)
    expected = c.Element(c.Name("golden_hash"), c.Binary("-", c.Name(_STEP), c.Unsigned(first)))
    scope.add(c.Return(c.Binary("!=", c.Name(_HASH), expected)))
    arguments = (c.Argument(f"const {prefix}_state_t *", _STATE), c.Argument("uint32_t", _STEP))
    return scope.function(f"{prefix}_state_differs", "bool", arguments)

"""Removes the statements of a traced kernel whose values nothing uses."""

from __future__ import annotations

from typing import assert_never

from compiler.kernels.trace.statements import (
    Assign,
    Block,
    Branch,
    Call,
    Operand,
    Statement,
    operation_operands,
)


def drop_unused(block: Block) -> Block:
    """The block with only the statements that its values need; the values stay the same.

    Before: any block. After: every target is used, except some of a call with several results.
    E.g. `a = x + 1; b = x · 2; values (b)` becomes `b = x · 2; values (b)`.
    """
    return _drop(block, set())


def _drop(block: Block, used: set[Operand]) -> Block:
    """Adds what the block reads to `used`."""
    used.update(block.values)
    kept: list[Statement] = []
    # backwards: whoever uses a value stands behind it, and has marked it by now
    for statement in reversed(block.statements):
        match statement:
            case Assign(target, operation):
                if target not in used:
                    continue
                used.update(operation_operands(operation))
                kept.append(statement)
            case Call(targets, _, arguments):
                # one result that is used keeps the call, with all of its results: C returns them
                # together
                if used.isdisjoint(targets):
                    continue
                used.update(arguments)
                kept.append(statement)
            case Branch(targets, condition, then, otherwise):
                # of a branch single values can go, and with them what only they need in either
                # block
                wanted = [i for i, target in enumerate(targets) if target in used]
                if not wanted:
                    continue
                first = _drop(_keep_values(then, wanted), used)
                second = _drop(_keep_values(otherwise, wanted), used)
                used.add(condition)
                kept.append(Branch(tuple(targets[i] for i in wanted), condition, first, second))
            case _:
                assert_never(statement)
    return Block(tuple(reversed(kept)), block.values)


def _keep_values(block: Block, wanted: list[int]) -> Block:
    return Block(block.statements, tuple(block.values[i] for i in wanted))

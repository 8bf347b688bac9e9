"""Removes the statements of a traced kernel whose values nothing uses."""

from __future__ import annotations

from typing import assert_never

from compiler.kernels.trace import statements as traced


def drop_unused(block: traced.Block) -> traced.Block:
    """The block with only the statements that its values need; the values stay the same.

    Before: any block. After: every target is used, except some of a call with several results.
    E.g. `a = x + 1; b = x · 2; values (b)` becomes `b = x · 2; values (b)`.
    """
    return _drop(block, set())


def _drop(block: traced.Block, used: set[traced.Operand]) -> traced.Block:
    """Adds what the block reads to `used`."""
    used.update(block.values)
    kept: list[traced.Statement] = []
    # backwards: whoever uses a value stands behind it, and has marked it by now
    for statement in reversed(block.statements):
        match statement:
            case traced.Assign(target, operation):
                if target not in used:
                    continue
                used.update(traced.operation_operands(operation))
                kept.append(statement)
            case traced.Call(targets, _, arguments):
                # one result that is used keeps the call, with all of its results: C returns them
                # together
                if used.isdisjoint(targets):
                    continue
                used.update(arguments)
                kept.append(statement)
            case traced.Branch(targets, condition, then, otherwise):
                # of a branch single values can go, and with them what only they need in either
                # block
                wanted = [i for i, target in enumerate(targets) if target in used]
                if not wanted:
                    continue
                first = _drop(_keep_values(then, wanted), used)
                second = _drop(_keep_values(otherwise, wanted), used)
                used.add(condition)
                kept.append(
                    traced.Branch(tuple(targets[i] for i in wanted), condition, first, second)
                )
            case _:
                assert_never(statement)
    return traced.Block(tuple(reversed(kept)), block.values)


def _keep_values(block: traced.Block, wanted: list[int]) -> traced.Block:
    return traced.Block(block.statements, tuple(block.values[i] for i in wanted))

"""Removes statements of a traced kernel whose values are not used."""

from __future__ import annotations

from typing import assert_never

from compiler.kernels.trace import statements as traced


def drop_unused(block: traced.Block) -> traced.Block:
    """The block with only the statements that its values depend on.

    Before: any block. After: every target is used, except some of a call with several results. E.g.
    `a = x + 1; b = x · 2; values (b)` becomes `b = x · 2; values (b)`.
    """
    return _drop(block, set())


def _drop(block: traced.Block, used: set[traced.Operand]) -> traced.Block:
    """Removes unused statements, and adds the operands of the others to `used`."""
    used.update(block.values)
    kept: list[traced.Statement] = []
    # backwards: users come after a value and have marked it
    for statement in reversed(block.statements):
        match statement:
            case traced.Assign(target, operation):
                if target not in used:
                    continue
                used.update(traced.operation_operands(operation))
                kept.append(statement)
            case traced.Call(targets, _, arguments):
                # one used result keeps the call with all its results: C returns them together
                if used.isdisjoint(targets):
                    continue
                used.update(arguments)
                kept.append(statement)
            case traced.Branch(targets, condition, then, otherwise):
                # unused values of a branch are removed, with the statements for them in both blocks
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

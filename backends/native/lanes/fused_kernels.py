"""Finds the products of a math kernel that are rounded together with the sum they are added to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from compiler.kernels.trace.operand_uses import operands
from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Branch,
    Kind,
    Local,
    Operand,
    Operator,
    Routine,
)


@dataclass(frozen=True, slots=True)
class FusedSum:
    """first · second + addend, where the sign of the product or of the addend may be turned."""

    first: Operand
    second: Operand
    addend: Operand
    minus_product: bool
    minus_addend: bool


@dataclass(frozen=True, slots=True)
class FusedSums:
    """The sums by the index of the local they are assigned to, and the products in them."""

    sums: Mapping[int, FusedSum]
    products: frozenset[int]


def fused_sums(routine: Routine) -> FusedSums:
    """The sums and differences of which one operand is a product that nothing else reads.

    Of two products the right one is fused. The exact errors of `double_word` stay exact: they read
    a rounded product twice, and their other products are exact.
    """
    assigned = list(_assigned(routine.body))
    uses = Counter(operands(routine.body))
    products: dict[Operand, Binary] = {}
    sums: dict[int, FusedSum] = {}
    taken: set[int] = set()
    for target, operation in assigned:
        match operation.operator:
            case Operator.MULTIPLY if uses[target] == 1:
                products[target] = operation
            case Operator.ADD | Operator.SUBTRACT as operator:
                negative = operator is Operator.SUBTRACT
                for term, addend, right in (
                    (operation.right, operation.left, True),
                    (operation.left, operation.right, False),
                ):
                    if isinstance(term, Local) and term in products:
                        product = products[term]
                        sums[target.index] = FusedSum(
                            first=product.left,
                            second=product.right,
                            addend=addend,
                            minus_product=negative and right,
                            minus_addend=negative and not right,
                        )
                        taken.add(term.index)
                        break
            case _:
                pass
    return FusedSums(sums, frozenset(taken))


def _assigned(block: Block) -> Iterator[tuple[Local, Binary]]:
    """The operations on two reals, in order."""
    for statement in block.statements:
        match statement:
            case Assign(target, Binary() as operation) if target.kind is Kind.REAL:
                yield target, operation
            case Branch(_, _, then, otherwise):
                yield from _assigned(then)
                yield from _assigned(otherwise)
            case _:
                pass

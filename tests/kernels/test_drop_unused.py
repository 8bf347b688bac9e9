"""Statements that nothing uses leave the routine, the others stay in order."""

from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Branch,
    Constant,
    Local,
    Operator,
    ValueKind,
    drop_unused,
)

ONE = Constant(ValueKind.REAL, 1.0)
X = Local(1, ValueKind.REAL, "x")
HOLDS = Local(2, ValueKind.TRUTH, "")


def real(index: int) -> Local:
    return Local(index, ValueKind.REAL, "")


def plus_one(target: Local, operand: Local) -> Assign:
    return Assign(target, Binary(Operator.ADD, operand, ONE))


def test_a_chain_without_a_reader_goes() -> None:
    used = plus_one(real(3), X)
    block = Block((used, plus_one(real(4), X), plus_one(real(5), real(4))), (real(3),))
    assert drop_unused(block) == Block((used,), (real(3),))


def test_a_branch_keeps_the_values_that_are_read() -> None:
    then = Block((plus_one(real(3), X), plus_one(real(4), X)), (real(3), real(4)))
    otherwise = Block((), (X, ONE))
    branch = Branch((real(5), real(6)), HOLDS, then, otherwise)
    wanted = Branch(
        (real(6),), HOLDS, Block((plus_one(real(4), X),), (real(4),)), Block((), (ONE,))
    )
    assert drop_unused(Block((branch,), (real(6),))) == Block((wanted,), (real(6),))


def test_a_branch_without_a_reader_goes_with_its_condition() -> None:
    condition = Assign(HOLDS, Binary(Operator.LESS, X, ONE))
    branch = Branch((real(5),), HOLDS, Block((), (X,)), Block((), (ONE,)))
    assert drop_unused(Block((condition, branch), (X,))) == Block((), (X,))

"""The names of the language and what the compiler does with them are the same set."""

from compiler.builtins.table import LOWERINGS
from compiler.ir.scalars import SIGNATURES


def test_every_builtin_is_lowered_and_nothing_else() -> None:
    missing, unknown = SIGNATURES.keys() - LOWERINGS.keys(), LOWERINGS.keys() - SIGNATURES.keys()
    assert not missing, f"give them a lowering in compiler/builtins/table.py: {sorted(missing)}"
    assert not unknown, f"declare them in spec_schema/expressions/language.py: {sorted(unknown)}"

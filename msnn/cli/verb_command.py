"""Defines commands with helpful errors for unexpected arguments."""

from __future__ import annotations

from typing import Any

from typer import BadParameter
from typer.core import TyperCommand, TyperGroup

from spec_schema.diagnostics.printable import printable

# typer has it by no name of its own
_UsageError: Any = BadParameter.__bases__[0]


class VerbGroup(TyperGroup):
    """Suggests the position of an option that is placed before the command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Like typer, except for an option that may belong to a command."""
        first, *others = args or [""]
        own = {option for parameter in self.get_params(ctx) for option in parameter.opts}
        verb = next((word for word in others if word in self.commands), None)
        if first.startswith("-") and first not in own and verb and not ctx.resilient_parsing:
            ctx.fail(f"`{first}` stands before its verb; write `{ctx.command_path} {verb} {first}`")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Like typer; quoted parts of the command line are made printable."""
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            error.message = printable(error.message)
            raise


class VerbCommand(TyperCommand):
    """Rejects extra arguments; data files are passed by an option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Like typer; extra arguments end the command with a suggestion."""
        # so that click hands the words back instead of refusing them without a repair
        ctx.allow_extra_args = True
        left = super().parse_args(ctx, args)
        # completion in a shell parses half a command line, which is no mistake
        if left and not ctx.resilient_parsing:
            options = {option for parameter in self.params for option in parameter.opts}
            words = " ".join(left)
            said = f"`{words}` is more than `{ctx.command_path}` takes"
            repair = f": write `--data {words}`" if len(left) == 1 and "--data" in options else ""
            if len(left) > 1 and "--data" in options:
                repair = ": write `--data` before each file of data"
            ctx.fail(f"{said}{repair}")
        return left

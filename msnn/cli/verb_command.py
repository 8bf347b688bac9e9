"""Defines a command with helpful errors for unexpected arguments."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand


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

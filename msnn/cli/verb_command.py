"""Defines a command with helpful errors for unexpected arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from typer.core import TyperCommand

from spec_schema.plugins import look_up
from spec_schema.registry import Feature, TargetLine, VerbLine


def plugin_rows(
    kind: str, lines: Callable[[Feature], Sequence[VerbLine | TargetLine]]
) -> list[tuple[str, str]]:
    """Each name that plug-ins bring of a kind, and its help with package and version."""
    from msnn.cli.console import report

    plugins = look_up()
    report(plugins.warnings, ())
    return [
        (line.key, f"{line.help.rstrip('.')} ({plugin.package} {plugin.version})")
        for plugin in plugins.found
        for line in lines(plugin.feature)
        if (kind, line.key) in plugin.keys
    ]


class VerbCommand(TyperCommand):
    """Rejects extra arguments, and a second value of an option that takes one.

    Data files are passed by an option.
    """

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Like typer; the help of `export` also lists the targets of plug-ins."""
        super().format_options(ctx, formatter)
        rows = (
            plugin_rows("target", lambda feature: feature.targets) if self.name == "export" else []
        )
        if rows:
            with formatter.section("Targets of plug-ins"):
                formatter.write_dl(rows)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Like typer; extra words and values end the command with a suggestion."""
        if not ctx.resilient_parsing:
            self._refuse_repeated(ctx, args)
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

    def _refuse_repeated(self, ctx: Any, args: list[str]) -> None:
        """Ends the command where typer would take the last of several values silently."""
        parser: Any = self.make_parser(ctx)
        _, _, given = parser.parse_args(list(args))
        for option in given:
            times = given.count(option)
            takes_many = option.param_type_name != "option" or option.multiple or option.is_flag
            if times > 1 and not takes_many:
                ctx.fail(f"`{option.opts[-1]}` is given {times} times, and takes one value")

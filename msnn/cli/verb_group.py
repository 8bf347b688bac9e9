"""Defines the group of all commands, which finds those of plug-ins by name."""

from __future__ import annotations

import copy
from contextlib import suppress
from typing import Any

import typer
from typer.core import TyperGroup

from msnn.cli.console import report
from msnn.cli.manners import with_manners
from msnn.cli.verb_command import VerbCommand, plugin_rows
from spec_schema.diagnostics.source import printable
from spec_schema.diagnostics.suggest import nearest
from spec_schema.plugins import Plugin, look_up, plugins_with
from spec_schema.registry import VERBS, VerbLine

# typer has it by no name of its own
_UsageError: Any = typer.BadParameter.__bases__[0]


def plugin_with_verb(name: str) -> Plugin | None:
    """The plug-in that brings a verb; looks plug-ins up."""
    look_up()
    return next(iter(plugins_with([("verb", name)])), None)


class VerbGroup(TyperGroup):
    """Suggests the position of an option before the command, and has the verbs of plug-ins.

    Plug-ins are looked up for a verb that is not ours, for `--help`, and for completion.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Like typer, except for an option that may belong to a command."""
        first, *others = args or [""]
        own = {option for parameter in self.get_params(ctx) for option in parameter.opts}
        verb = next((word for word in others if word in self.commands), None)
        if first.startswith("-") and first not in own and verb and not ctx.resilient_parsing:
            ctx.fail(f"`{first}` stands before its verb; write `{ctx.command_path} {verb} {first}`")
        return super().parse_args(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Like typer; a verb that is not ours may be one of a plug-in."""
        ours = super().get_command(ctx, cmd_name)
        if ours is not None or plugin_with_verb(cmd_name) is None:
            return ours
        # where a shell completes, one that is wrong must not hide the others
        with suppress(*([Exception] if ctx.resilient_parsing else [])):
            return _command_of(VERBS[cmd_name])
        return None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Like typer; the message for an unknown verb knows those of plug-ins."""
        try:
            return super().resolve_command(ctx, args)
        except _UsageError as error:
            # perhaps the plug-in that brings the verb does not work
            report(look_up().warnings, ())
            meant = nearest(args[0], VERBS)
            if meant is not None and "Did you mean" not in error.message:
                error.message = f"{error.message.rstrip('.')}. Did you mean {meant!r}?"
            raise

    def list_commands(self, ctx: Any) -> list[str]:
        """Like typer; completion also offers the verbs of plug-ins."""
        ours = super().list_commands(ctx)
        if not ctx.resilient_parsing:
            return ours
        look_up()
        return [*ours, *VERBS]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Like typer, with a group for the verbs of plug-ins, each with its package and version."""
        super().format_commands(ctx, formatter)
        rows = plugin_rows("verb", lambda feature: feature.verbs)
        if rows:
            with formatter.section("Plug-ins"):
                formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        """Like typer; quoted parts of the command line are made printable."""
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            error.message = printable(error.message)
            raise


def _command_of(line: VerbLine) -> Any:
    """The command of a plug-in, with the options that every verb has."""
    whole = typer.Typer(cls=TyperGroup, add_completion=False, rich_markup_mode=None)
    whole.callback()(_no_options)
    verb = line.command.value
    if isinstance(verb, typer.Typer):
        whole.add_typer(_with_manners(verb), name=line.key, help=line.help, no_args_is_help=True)
    else:
        text = verb.__doc__ or line.help
        whole.command(line.key, cls=VerbCommand, help=text)(with_manners(verb))
    group: Any = typer.main.get_command(whole)
    return group.commands[line.key]


def _no_options() -> None:
    """Makes typer build a group, of one command too."""


def _with_manners(app: typer.Typer) -> typer.Typer:
    """A copy of an application of several commands, each with the options that every verb has."""
    copied = copy.copy(app)
    copied.registered_commands = [copy.copy(info) for info in app.registered_commands]
    for info in copied.registered_commands:
        assert info.callback is not None
        info.callback = with_manners(info.callback)
    copied.registered_groups = [copy.copy(info) for info in app.registered_groups]
    for info in copied.registered_groups:
        assert info.typer_instance is not None
        info.typer_instance = _with_manners(info.typer_instance)
    return copied

"""Defines commands with helpful errors, and their group, which finds those of plug-ins."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from msnn.cli.console import report
from msnn.cli.output_options import with_manners
from msnn.cli.plugin_verb import guarded_verb, refuse_twin_options
from spec_schema.diagnostics.source import printable
from spec_schema.diagnostics.suggest import nearest
from spec_schema.plugins import Plugin, look_up, plugins_with
from spec_schema.registry import VERBS, Feature, TargetLine, VerbLine

# typer has it by no name of its own
_UsageError: Any = typer.BadParameter.__bases__[0]


def plugin_with_verb(name: str) -> Plugin | None:
    """The plug-in that brings the command `name`; None if no installed plug-in has it."""
    look_up()
    return next(iter(plugins_with([("verb", name)])), None)


class VerbGroup(TyperGroup):
    """The commands of msnn and of plug-ins. An option before its command is an error with a repair.

    Plug-ins are looked up for a command that is not msnn's own, for `--help`, and for completion.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Like typer, but an option before the command that has it is a usage error with the right
        order.
        """
        first, *others = args or [""]
        own = {option for parameter in self.get_params(ctx) for option in parameter.opts}
        verb = next((word for word in others if word in self.commands), None)
        if first.startswith("-") and first not in own and verb and not ctx.resilient_parsing:
            ctx.fail(f"`{first}` stands before its verb; write `{ctx.command_path} {verb} {first}`")
        return super().parse_args(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Like typer, but also finds the commands of plug-ins. None if there is none of
        this name.
        """
        ours = super().get_command(ctx, cmd_name)
        if ours is not None or plugin_with_verb(cmd_name) is None:
            return ours
        # where a shell completes, one that is wrong must not hide the others
        with suppress(*([Exception] if ctx.resilient_parsing else [])):
            return _command_of(VERBS[cmd_name])
        return None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Like typer, but for an unknown command also suggests those of plug-ins, and reports
        plug-ins that do not work.
        """
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
        """Like typer, but completion in a shell also offers the commands of plug-ins."""
        ours = super().list_commands(ctx)
        if not ctx.resilient_parsing:
            return ours
        look_up()
        return [*ours, *VERBS]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Like typer, with another group for the commands of plug-ins, each with its package and
        version.
        """
        super().format_commands(ctx, formatter)
        rows = plugin_rows("verb", lambda feature: feature.verbs)
        if rows:
            with formatter.section("Plug-ins"):
                formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        """Like typer, but control characters in quoted parts of the command line are escaped in
        messages.
        """
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            error.message = printable(error.message)
            raise


def _command_of(line: VerbLine) -> Any:
    """The command of a plug-in, with the options that every command has."""
    whole = typer.Typer(cls=TyperGroup, add_completion=False, rich_markup_mode=None)
    whole.callback()(_no_options)
    verb = line.command.value
    if isinstance(verb, typer.Typer):
        whole.add_typer(
            _with_manners(verb, line.command.module),
            name=line.key,
            help=line.help,
            no_args_is_help=True,
        )
    else:
        text = verb.__doc__ or line.help
        whole.command(line.key, cls=VerbCommand, help=text)(
            with_manners(guarded_verb(verb, line.command.module))
        )
    group: Any = typer.main.get_command(whole)
    command = group.commands[line.key]
    refuse_twin_options(command)
    return command


def _no_options() -> None:
    """Does nothing; a callback makes typer build a group even for a single command."""


def _with_manners(app: typer.Typer, module: str) -> typer.Typer:
    """A copy of a plug-in's application with several commands, each with the options that every
    command has. `module` is the plug-in's.
    """
    copied = copy.copy(app)
    copied.registered_commands = [copy.copy(info) for info in app.registered_commands]
    for info in copied.registered_commands:
        assert info.callback is not None
        info.callback = with_manners(guarded_verb(info.callback, module))
    copied.registered_groups = [copy.copy(info) for info in app.registered_groups]
    for info in copied.registered_groups:
        assert info.typer_instance is not None
        info.typer_instance = _with_manners(info.typer_instance, module)
    return copied


def plugin_rows(
    kind: str, lines: Callable[[Feature], Sequence[VerbLine | TargetLine]]
) -> list[tuple[str, str]]:
    """Rows for `--help` of the names that plug-ins bring: each with its help, package and version.

    `kind` is `verb` or `target`; `lines` returns the entries of that kind of a feature. Warnings
    about plug-ins are reported.
    """
    plugins = look_up()
    report(plugins.warnings, ())
    return [
        (line.key, f"{line.help.rstrip('.')} ({plugin.package} {plugin.version})")
        for plugin in plugins.found
        for line in lines(plugin.feature)
        if (kind, line.key) in plugin.keys
    ]


class VerbCommand(TyperCommand):
    """A command that rejects extra arguments, and a second value of an option that takes one.

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
        """Like typer, but extra words and repeated values are a usage error with a suggestion."""
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
        """A usage error for an option that is given several times and takes one value; typer would
        silently use the last.
        """
        parser: Any = self.make_parser(ctx)
        _, _, given = parser.parse_args(list(args))
        for option in given:
            times = given.count(option)
            takes_many = option.param_type_name != "option" or option.multiple or option.is_flag
            if times > 1 and not takes_many:
                ctx.fail(f"`{option.opts[-1]}` is given {times} times, and takes one value")

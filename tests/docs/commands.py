"""Verbs, arguments, options and exit codes, from the command line itself."""

from __future__ import annotations

import inspect
import re
from enum import Enum
from inspect import isclass
from typing import Any, get_args

from typer.models import ArgumentInfo, CommandInfo, ParameterInfo

from msnn.cli.application import application
from msnn.cli.output_options import ADDED
from tests.docs.markdown import apart, paragraph, prose, table

Row = tuple[str, str, str]


def verbs() -> str:
    """What all verbs take, then a section a verb."""
    commands = application().registered_commands
    first = next(command for command in commands if command.name == "check").callback
    assert first is not None
    parameters = inspect.signature(first).parameters
    common = [_option(name, parameters[name]) for name in ADDED]
    return apart(
        table(("every verb", "", "default"), common), *(_verb(command) for command in commands)
    )


def exit_codes() -> str:
    """What `msnn --help` says of them."""
    rows = re.findall(r"(\d+) ([^,.]+)", str(application().info.epilog))
    return table(("code", "meaning"), rows)


def _verb(command: CommandInfo) -> str:
    assert command.callback is not None
    usage, arguments, options = [f"msnn {command.name}"], list[Row](), list[Row]()
    parameters = inspect.signature(command.callback, eval_str=True).parameters
    for name, parameter in parameters.items():
        info = _meaning(parameter)[1]
        if isinstance(info, ArgumentInfo):
            usage.append(str(info.metavar))
            arguments.append((f"`{info.metavar}`", paragraph(info.help), ""))
        elif name not in ADDED:
            options.append(_option(name, parameter))
    text = prose(inspect.getdoc(command.callback))
    rows = [*arguments, *options]
    listed = [table(("", "", "default"), rows)] if rows else []
    return apart(f"## `{' '.join(usage)}`", text, *listed)


def _meaning(parameter: inspect.Parameter) -> tuple[Any, ParameterInfo]:
    type, *notes = get_args(parameter.annotation)
    (info,) = (note for note in notes if isinstance(note, ParameterInfo))
    return type, info


def _option(name: str, parameter: inspect.Parameter) -> Row:
    type, info = _meaning(parameter)
    return f"`{_spelling(name, info, type)}`", paragraph(info.help), _default(parameter.default)


def _spelling(name: str, info: ParameterInfo, type: Any) -> str:
    # within Annotated typer keeps the first spelling where a default would stand
    given = [s for s in (info.default, *(info.param_decls or ())) if isinstance(s, str)]
    option = ", ".join(given or [f"--{name.replace('_', '-')}"])
    if type is bool:
        return option
    choices = next((t for t in (type, *get_args(type)) if isclass(t) and issubclass(t, Enum)), ())
    value = info.metavar or "|".join(str(choice.value) for choice in choices)
    return f"{option} {value}"


def _default(value: Any) -> str:
    shown = value.value if isinstance(value, Enum) else value
    return "" if shown in (None, False, "") else f"`{shown}`"

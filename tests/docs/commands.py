"""Verbs, arguments, options and exit codes, from the command line itself."""

from __future__ import annotations

import inspect
import re
from enum import Enum
from inspect import isclass
from typing import Any, get_args

from typer.models import ArgumentInfo, CommandInfo, ParameterInfo

from msnn.cli.application import app
from tests.docs.markdown import apart, paragraph, table

Row = tuple[str, str, str]


def verbs() -> str:
    """A section a verb."""
    return apart(*(_verb(command) for command in app.registered_commands))


def exit_codes() -> str:
    """What `msnn --help` says of them."""
    rows = re.findall(r"(\d+) ([^,.]+)", str(app.info.epilog))
    return table(("code", "meaning"), rows)


def _verb(command: CommandInfo) -> str:
    assert command.callback is not None
    usage, arguments, options = [f"msnn {command.name}"], list[Row](), list[Row]()
    parameters = inspect.signature(command.callback, eval_str=True).parameters
    for name, parameter in parameters.items():
        type, *notes = get_args(parameter.annotation)
        (info,) = (note for note in notes if isinstance(note, ParameterInfo))
        about = paragraph(info.help)
        if isinstance(info, ArgumentInfo):
            usage.append(str(info.metavar))
            arguments.append((f"`{info.metavar}`", about, ""))
        else:
            options.append((f"`{_spelling(name, info, type)}`", about, _default(parameter.default)))
    text = paragraph(inspect.getdoc(command.callback))
    rows = [*arguments, *options]
    return apart(f"## `{' '.join(usage)}`", text, table(("", "", "default"), rows))


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

"""Fills the C templates; model-specific parts are passed as finished text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from backends.c_language.layout import comment, wrapped
from backends.files.text_templates import text_templates


class Generated(Protocol):
    """The facts that every file of an export needs: model name and prefix."""

    @property
    def model(self) -> str:
        """Name of the program."""
        ...

    @property
    def prefix(self) -> str: ...

    @property
    def takes_parameters(self) -> bool:
        """True if functions have a pointer to parameters."""
        ...


@dataclass(frozen=True, slots=True)
class GeneratedNames:
    """The names of an export whose functions have no parameters pointer."""

    model: str
    prefix: str
    takes_parameters: bool = False


_WITHOUT_JACOBIAN = {"jacobian": False, "letters": (), "vectors": (), "vector_functions": ()}
_WITHOUT_CALIBRATION = {"calibrates": False}


def render(template: str, interface: Generated, title: str, folder: str = "c", **facts: Any) -> str:
    """Renders a template of a folder of `templates`, with the common names."""
    prefix = interface.prefix
    banner = comment(f"{title} of the model `{interface.model}`. Made by msnn; do not edit.")
    common = {
        "banner": banner,
        "prefix": prefix,
        "macro": prefix.upper(),
        "takes_parameters": interface.takes_parameters,
        "params": f", &{prefix}_params_default" if interface.takes_parameters else "",
        **_WITHOUT_JACOBIAN,
        **_WITHOUT_CALIBRATION,
    }
    # facts of a file override the defaults; most files have no Jacobian and no calibration
    text = text_templates().get_template(f"{folder}/{template}").render(common | facts)
    if not template.endswith((".c.j2", ".h.j2")):
        return text
    return "\n".join(part for line in text.split("\n") for part in _fitted(line))


def _fitted(line: str) -> list[str]:
    """Wraps a line that is too long; preprocessor directives cannot be wrapped."""
    # a directive ends with its line
    return [line] if line.startswith("#") else wrapped(line)

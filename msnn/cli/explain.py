"""`msnn explain`: what a diagnostic code means, why it is said, and an example of the repair."""

from __future__ import annotations

from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat


def explain(
    codes: Annotated[
        list[str] | None, typer.Argument(metavar="[CODE…]", help="Codes such as E0301.")
    ] = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Say what a diagnostic code means.

    Why it is said, a spec that gets it, and the same spec repaired. Without a code: a list of all.
    """
    from msnn.cli.console import json_result, result
    from spec_schema.explain import explain, known_codes

    found = [explain(code) for code in codes or known_codes()]
    if format is ResultFormat.JSON:
        records = [{"code": f.code, "meaning": f.meaning, "markdown": f.page} for f in found]
        json_result("explain", {"codes": records})
    elif codes:
        result("\n\n\n".join(explanation.text for explanation in found))
    else:
        result("\n".join(f"{explanation.code}  {explanation.meaning}" for explanation in found))

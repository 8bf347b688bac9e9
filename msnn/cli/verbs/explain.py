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
    """Explain a diagnostic code.

    Prints its meaning, its reason, a spec that causes it, and the same spec repaired. Without a
    code: a list of all.
    """
    from msnn.cli.console import json_result, result
    from msnn.errors.commands import unknown_code
    from spec_schema.diagnostics.diagnostic import SpecError
    from spec_schema.diagnostics.explain import explain, known_codes
    from spec_schema.diagnostics.suggest import nearest

    known = known_codes()
    unknown = [code for code in codes or () if code.strip().upper() not in known]
    if unknown:
        raise SpecError([unknown_code(c, nearest(c.strip().upper(), known)) for c in unknown])
    found = [explain(code) for code in codes or known]
    if format is ResultFormat.JSON:
        records = [{"code": f.code, "meaning": f.meaning, "markdown": f.page} for f in found]
        json_result("explain", {"codes": records})
    elif codes:
        result("\n\n\n".join(explanation.text for explanation in found))
    else:
        result("\n".join(f"{explanation.code}  {explanation.meaning}" for explanation in found))

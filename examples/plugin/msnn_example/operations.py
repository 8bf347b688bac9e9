"""The verb `operations`: counts the operations of a step by kind."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

import msnn
from msnn.extending import json_result, report, result


def operations(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="A spec, or the folder of a run.")],
    as_json: Annotated[bool, typer.Option("--json", help="The result as JSON.")] = False,
) -> None:
    """Count the operations of a step by kind."""
    model = msnn.load(spec)
    report(model.warnings, model.sources)
    counts = Counter(type(node.op).__name__ for node in model.program.step.nodes)
    if as_json:
        json_result("operations", {"operations": dict(counts)})
    else:
        result("\n".join(f"{kind:16} {number}" for kind, number in counts.most_common()))

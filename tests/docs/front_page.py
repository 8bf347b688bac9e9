"""The first page of the site: a spec, its picture, its C, and figures of results files."""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path
from typing import Any

from msnn.api import models
from msnn.reports.diagram.svg import architecture_svg
from tests.docs.markdown import table

_ROOT = Path(__file__).parents[2]
_SPEC = _ROOT / "examples" / "ci" / "specs" / "heater.msnn.yaml"
PICTURE = _ROOT / "docs" / "figures" / "heater.svg"


def front_spec() -> str:
    """What the model is, without how it is trained."""
    model = _SPEC.read_text(encoding="utf-8").partition("\ndata:")[0]
    return f"```yaml\n{model.rstrip()}\n```"


def front_picture() -> str:
    """What `msnn show --graph svg` draws of it."""
    return architecture_svg(models.load(_SPEC).spec)


def front_c() -> str:
    """The formulas of the step that `msnn export --to c` writes of it."""
    with tempfile.TemporaryDirectory() as folder:
        models.export(models.load(_SPEC), "c", folder)
        text = Path(folder, "src", "heater.c").read_text(encoding="utf-8")
    (step,) = re.findall(r"^heater_status_t heater_step\(.*?^\}", text, re.MULTILINE | re.DOTALL)
    return f"```c\n{step}\n```"


def front_figures() -> str:
    """What examples have measured, each with the command that measures it again."""
    tank, car = (_results(name) for name in ("mpc_tank", "vehicle_steering"))
    loop, solves, ipopt = tank["loop"], tank["solves"], tank["ipopt"]
    errors, exported = car["open_loop"], car["export"]
    least, mean, most = exported["board"]["instructions"]
    rows = [
        (
            "error of a tank's level under the learned predictive controller, rms",
            "; ".join(
                (
                    f"{loop['mpc']['rms']:.2f} cm",
                    f"told only what is wanted now {loop['now']['rms']:.2f} cm",
                    f"PI {loop['pi']['rms']:.2f} cm",
                )
            ),
            _demo("mpc_tank"),
        ),
        (
            "time of one solve, median",
            f"{solves['ms'][0]:.1f} ms; ipopt {ipopt['ms'][0]:.1f} ms",
            _demo("mpc_tank"),
        ),
        (
            "curvature of a steered car, mean square error",
            f"{errors['controller']['mse']:.1e} 1/m²; perceptron {errors['mlp']['mse']:.1e} 1/m²",
            _demo("vehicle_steering"),
        ),
        (
            "its C along the test drive, beside msnn's interpreter",
            f"{exported['bits']} differing bits",
            _demo("vehicle_steering"),
        ),
        (
            "instructions of its step on a Cortex-M4F: least, mean, most",
            f"{least}, {mean:.0f}, {most}",
            _demo("vehicle_steering"),
        ),
    ]
    return table(("measured in examples", "", "by"), rows)


def _demo(example: str) -> str:
    return f"`python examples/{example}/demo.py`"


def _results(example: str) -> dict[str, Any]:
    file = _ROOT / "examples" / example / "results.json"
    return json.loads(file.read_text(encoding="utf-8"))

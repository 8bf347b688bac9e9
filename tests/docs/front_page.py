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
    """The model of the spec, without its data and training."""
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
    """Measurements of the examples, each with the command that repeats it."""
    tank, car = (_results(name) for name in ("mpc_tank", "vehicle_steering"))
    loop, solves, ipopt = tank["loop"], tank["solves"], tank["ipopt"]
    errors, exported = car["open_loop"], car["export"]
    low, mean, high = exported["board"]["instructions"]
    rows = [
        (
            "tank level, RMS error",
            ", ".join(
                (
                    f"MPC with preview {loop['mpc']['rms']:.2f} cm",
                    f"without preview {loop['now']['rms']:.2f} cm",
                    f"PI {loop['pi']['rms']:.2f} cm",
                )
            ),
            _demo("mpc_tank"),
        ),
        (
            "time of one MPC solve, median",
            f"{solves['ms'][0]:.1f} ms; ipopt {ipopt['ms'][0]:.1f} ms",
            _demo("mpc_tank"),
        ),
        (
            "curvature of a steered car, mean squared error",
            f"{errors['controller']['mse']:.1e} 1/m²; perceptron {errors['mlp']['mse']:.1e} 1/m²",
            _demo("vehicle_steering"),
        ),
        (
            "its C compared with the reference interpreter, test drive",
            f"{exported['bits']} differing bits",
            _demo("vehicle_steering"),
        ),
        (
            "instructions of its step on a Cortex-M4F: min, mean, max",
            f"{low}, {mean:.0f}, {high}",
            _demo("vehicle_steering"),
        ),
    ]
    return table(("measured in examples", "", "by"), rows)


def _demo(example: str) -> str:
    return f"`python examples/{example}/demo.py`"


def _results(example: str) -> dict[str, Any]:
    file = _ROOT / "examples" / example / "results.json"
    return json.loads(file.read_text(encoding="utf-8"))

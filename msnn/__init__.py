"""The tool people touch: specs to trained, validated and exported models.

import msnn

model = msnn.load("plant.msnn.yaml")
result = msnn.train(model)
msnn.export(model, "c", "firmware/plant", result.weights)
"""

from __future__ import annotations

from msnn.cli.interrupts import expect_early_interrupts

expect_early_interrupts()

from importlib import import_module  # noqa: E402  (each takes long enough for a Ctrl-C)
from typing import TYPE_CHECKING, Any  # noqa: E402

from msnn.project.package_names import check_package_names  # noqa: E402

check_package_names()

if TYPE_CHECKING:
    from msnn.api.comparisons import compare, sweep
    from msnn.api.measurements import check_data, simulate, validate
    from msnn.api.models import (
        compile,
        estimator,
        export,
        import_nnodely,
        initial_weights,
        linearize,
        load,
        mpc,
        stepper,
        torch_module,
    )
    from msnn.api.reports import report
    from msnn.api.trainings import stage_loss, train, train_folds
    from msnn.errors.failures import MissingExtraError
    from msnn.model.model import Model
    from msnn.training.training_result import TrainingDivergedError, TrainingInterruptedError
    from spec_schema.diagnostics.diagnostic import SpecError

__all__ = [
    "MissingExtraError",
    "Model",
    "SpecError",
    "TrainingDivergedError",
    "TrainingInterruptedError",
    "check_data",
    "compare",
    "compile",
    "estimator",
    "export",
    "import_nnodely",
    "initial_weights",
    "linearize",
    "load",
    "mpc",
    "report",
    "simulate",
    "stage_loss",
    "stepper",
    "sweep",
    "torch_module",
    "train",
    "train_folds",
    "validate",
]

_HOMES = {
    "MissingExtraError": "msnn.errors.failures",
    **dict.fromkeys(
        ("TrainingDivergedError", "TrainingInterruptedError"), "msnn.training.training_result"
    ),
    "Model": "msnn.model.model",
    "SpecError": "spec_schema.diagnostics.diagnostic",
    "import_nnodely": "msnn.api.models",
    **dict.fromkeys(("compare", "sweep"), "msnn.api.comparisons"),
    **dict.fromkeys(("check_data", "simulate", "validate"), "msnn.api.measurements"),
    "report": "msnn.api.reports",
    **dict.fromkeys(("stage_loss", "train", "train_folds"), "msnn.api.trainings"),
}


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first used, so that `import msnn` costs nothing."""
    if name == "__version__":
        return import_module("spec_schema.version").__version__
    if name not in __all__:
        raise AttributeError(f"module `msnn` has no attribute `{name}`")
    return getattr(import_module(_HOMES.get(name, "msnn.api.models")), name)


def __dir__() -> list[str]:
    return sorted(["__doc__", "__version__", *__all__])

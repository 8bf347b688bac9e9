"""Lists the targets of exports: a line each, so that help texts name them without loading one."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

from msnn.errors.failures import MissingExtraError


@dataclass(frozen=True, slots=True)
class Package:
    """A Python package that runs what a target wrote; an extra of msnn installs it."""

    name: str
    extra: str
    purpose: str
    """For `msnn doctor`."""
    what: str
    """It, in the sentence that says that it is not installed."""

    def require(self) -> None:
        """Raises MissingExtraError where it is not installed."""
        if importlib.util.find_spec(self.name) is None:
            raise MissingExtraError(self.what, f"pip install 'msnn[{self.extra}]'")


@dataclass(frozen=True, slots=True)
class ListedTarget:
    """What is said of a target before it is loaded, from `msnn/exports/targets/<name>.py`."""

    name: str
    """On the command line, in `export:`, and of its folder."""
    title: str
    about: str
    extras: tuple[str, ...] = ()
    """What `--with` and the spec's `with:` may name beside the step."""
    package: Package | None = None
    """What must be installed besides to run what it writes."""


TARGETS = (
    ListedTarget("torch", "torch", "a module that needs only torch"),
    ListedTarget(
        "onnx",
        "ONNX",
        "models with explicit states",
        package=Package(
            name="onnxruntime",
            extra="onnxruntime",
            purpose="runs ONNX exports for `export --check`",
            what="onnxruntime, which runs ONNX models,",
        ),
    ),
    ListedTarget("casadi", "CasADi", "functions with named ports"),
    ListedTarget(
        "c",
        "C",
        "C99 in floating or fixed point, with a self-test",
        extras=("jacobian", "state_jacobian", "parameter_jacobian"),
    ),
    ListedTarget(
        "fmu",
        "FMU",
        "units for co-simulation by FMI 2.0 and 3.0",
        package=Package(
            name="fmpy",
            extra="fmu",
            purpose="validates and runs FMU exports for `export --check`",
            what="FMPy, which runs FMUs,",
        ),
    ),
)
NAMES = tuple(target.name for target in TARGETS)
EXTRAS = tuple(extra for target in TARGETS for extra in target.extras)
"""In the order in which they are written."""
PACKAGES = {target.name: target.package for target in TARGETS if target.package is not None}

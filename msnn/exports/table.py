"""Lists the targets of exports: a line each, so that help texts name them without loading one."""

from __future__ import annotations

from msnn.packages import CASADI, FMPY, ONNX, ONNXRUNTIME, TORCH, OptionalPackage
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class ListedTarget:
    """The facts of a target before it is loaded, from `msnn/exports/targets/<name>.py`."""

    name: str
    """On the command line, in `export:`, and of its folder."""
    title: str
    about: str
    of_online: bool = False
    """Whether it is of the sections `mpc` and `estimator` alone."""
    extras: tuple[str, ...] = ()
    """What `--with` and the spec's `with:` may name beside the step."""
    writer: OptionalPackage | None = None
    """What must be installed to write it."""
    runner: OptionalPackage | None = None
    """What must be installed besides to run what was written."""

    @property
    def can_be_written(self) -> bool:
        """Whether it needs nothing that is not installed."""
        return self.writer is None or self.writer.is_installed

    @property
    def left_out(self) -> str:
        """Says that it is not written, and what would change that."""
        assert self.writer is not None
        missing = f"{self.writer.name} is not installed; {self.writer.install}"
        return f"{self.name} is left out: {missing}"

    def require_writer(self) -> None:
        """Raises MissingExtraError where what writes it is not installed."""
        if self.writer is not None:
            self.writer.require(f"writes {self.title} exports")

    def require_runner(self) -> None:
        """Raises MissingExtraError where what runs it is not installed."""
        if self.runner is not None:
            self.runner.require(f"runs {self.title} models")


TARGETS = (
    ListedTarget("torch", "torch", "a module that needs only torch", writer=TORCH),
    ListedTarget(
        "onnx",
        "ONNX",
        "models with explicit states",
        writer=ONNX,
        runner=ONNXRUNTIME,
    ),
    ListedTarget("casadi", "CasADi", "functions with named ports", writer=CASADI),
    ListedTarget(
        "c",
        "C",
        "C99 in floating or fixed point, with a self-test",
        extras=("jacobian", "state_jacobian", "parameter_jacobian", "ros2"),
    ),
    ListedTarget(
        "fmu",
        "FMU",
        "units for co-simulation by FMI 2.0 and 3.0",
        runner=FMPY,
    ),
    ListedTarget(
        "mpc",
        "controllers",
        "the controller of an `mpc` section and the filter of an `estimator` as C99",
        of_online=True,
        extras=("fmu",),
    ),
)
NAMES = tuple(target.name for target in TARGETS)
_TARGETS_BY_NAME = {target.name: target for target in TARGETS}
EXTRAS = tuple(extra for target in TARGETS for extra in target.extras)
"""In the order in which they are written."""


def listed(name: str) -> ListedTarget:
    """The line of the table that has this name."""
    return _TARGETS_BY_NAME[name]

"""The `export` section: which targets are written, and of what."""

from typing import ClassVar

from spec_schema.entry import Entry
from spec_schema.plain_fields import Dtype, NewName, References


class Target(Entry):
    """What every target takes: `outputs` to keep (None: all), inputs to `close`, number type."""

    outputs: References | None = None
    close: References = ()
    dtype: Dtype | None = None


class TorchExport(Target):
    """A torch module."""

    noun: ClassVar[str] = "the torch export"


class OnnxExport(Target):
    """An ONNX model."""

    noun: ClassVar[str] = "the onnx export"


class CasadiExport(Target):
    """A CasADi function; names start with `prefix`, by default the name of the spec."""

    noun: ClassVar[str] = "the casadi export"

    prefix: NewName | None = None


class CExport(Target):
    """C sources; names start with `prefix`, by default the name of the spec."""

    noun: ClassVar[str] = "the c export"
    later: ClassVar[frozenset[str]] = frozenset(
        {"params", "ring", "unroll", "constant_time", "math"}
    )

    prefix: NewName | None = None


class Export(Entry):
    """The targets that `msnn export` writes; None where not asked for."""

    noun: ClassVar[str] = "export"
    later: ClassVar[frozenset[str]] = frozenset({"fmu", "mpc", "report"})

    torch: TorchExport | None = None
    onnx: OnnxExport | None = None
    casadi: CasadiExport | None = None
    c: CExport | None = None

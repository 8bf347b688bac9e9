"""Names the packages that msnn can do without, what each is for, and the line that installs it."""

from __future__ import annotations

import importlib.util
from typing import Any
from urllib.parse import unquote, urlsplit

from msnn.errors.failures import MissingExtraError
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class OptionalPackage:
    """A Python package that msnn can do without; `pip install msnn[extra]` installs it."""

    name: str
    """As Python imports it."""
    extra: str
    purpose: str
    """For `msnn doctor`."""
    distribution: str | None = None
    """As pip installs it, where that is another name."""

    @property
    def is_installed(self) -> bool:
        """True if Python finds the package; it is not imported."""
        try:
            return importlib.util.find_spec(self.name) is not None
        except ImportError:  # a finder that refuses the name
            return False

    @property
    def install(self) -> str:
        """The shell command that installs the package."""
        return install_line(self)

    def require(self, use: str) -> None:
        """Raises MissingExtraError if the package is not installed; `use` says what it is needed
        for.
        """
        if not self.is_installed:
            raise MissingExtraError(f"{self.name}, which {use},", self.install)


TORCH = OptionalPackage("torch", "torch", "trains on its engine and writes torch exports")
CASADI = OptionalPackage("casadi", "casadi", "writes CasADi exports")
ONNX = OptionalPackage("onnx", "onnx", "writes ONNX exports")
ONNXRUNTIME = OptionalPackage(
    "onnxruntime", "onnxruntime", "runs ONNX exports for `export --check`"
)
FMPY = OptionalPackage("fmpy", "fmu", "validates and runs FMU exports for `export --check`")
ELFTOOLS = OptionalPackage(
    "elftools", "a2l", "reads the addresses of variables for `msnn a2l`", distribution="pyelftools"
)
MATPLOTLIB = OptionalPackage("matplotlib", "plot", "draws plots")
PANDAS = OptionalPackage("pandas", "pandas", "makes frames of results")
OPENPYXL = OptionalPackage("openpyxl", "excel", "reads Excel workbooks")
PYARROW = OptionalPackage("pyarrow", "parquet", "reads Parquet")
SCIPY = OptionalPackage("scipy", "mat", "reads MATLAB files")
H5PY = OptionalPackage("h5py", "hdf5", "reads HDF5 and MATLAB 7.3 files")
ASAMMDF = OptionalPackage("asammdf", "mdf", "reads MDF")
ROSBAGS = OptionalPackage("rosbags", "ros", "reads ROS bags")
NPTDMS = OptionalPackage("nptdms", "tdms", "reads TDMS", distribution="npTDMS")
PYULOG = OptionalPackage("pyulog", "ulog", "reads ULog")
TENSORBOARD = OptionalPackage("tensorboard", "tensorboard", "draws curves of trainings")
ZIGLANG = OptionalPackage("ziglang", "zig", "is a C compiler, and runs models in reports")
PYGLS = OptionalPackage("pygls", "lsp", "speaks to editors: `msnn lsp`")
RAY = OptionalPackage("ray", "ray", "trains on a cluster: `msnn sweep --ray`")
OPTUNA = OptionalPackage("optuna", "optuna", "proposes values: `msnn sweep --optuna`")

OPTIONAL = (
    TORCH,
    CASADI,
    ONNX,
    ONNXRUNTIME,
    FMPY,
    ELFTOOLS,
    MATPLOTLIB,
    PANDAS,
    OPENPYXL,
    PYARROW,
    SCIPY,
    H5PY,
    ASAMMDF,
    ROSBAGS,
    NPTDMS,
    PYULOG,
    TENSORBOARD,
    ZIGLANG,
    PYGLS,
    RAY,
    OPTUNA,
)
"""In the order of `msnn doctor`."""


def install_line(package: OptionalPackage) -> str:
    """The command that adds a package to this installation of msnn.

    It names the folder or address that msnn was installed from, never the bare name of a package
    that somebody else could publish. Where that is not known, the package itself.
    """
    origin = _origin()
    if origin is None:
        return f"pip install {package.distribution or package.name}"
    url = str(origin.get("url"))
    if "dir_info" in origin:
        option = "-e " if origin["dir_info"].get("editable") else ""
        return f"pip install {option}'{unquote(urlsplit(url).path)}[{package.extra}]'"
    if "vcs_info" in origin:
        url = f"{origin['vcs_info']['vcs']}+{url}@{origin['vcs_info']['commit_id']}"
    return f"pip install 'msnn[{package.extra}] @ {url}'"


def _origin() -> dict[str, Any] | None:
    """The origin that the installer recorded by PEP 610; None if msnn was installed from an
    index.
    """
    import json  # only where something is missing
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        text = distribution("msnn").read_text("direct_url.json")
    except PackageNotFoundError:
        return None
    return None if text is None else json.loads(text)

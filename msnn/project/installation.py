"""Finds what is installed of all that msnn can use, and how to install what is missing."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from backends.files.c_compiler import CompilerMissingError, find_compiler
from msnn.exports.table import PACKAGES
from spec_schema.version import __version__


@dataclass(frozen=True)
class InstalledPart:
    """One part: what it is for, what was found of it, and what installs it where it is missing."""

    name: str
    purpose: str
    found: str | None
    install: str | None = None


# Distribution, extra, and what it is for; an extra of None comes with msnn.
_PACKAGES = (
    ("numpy", None, "arithmetic"),
    ("torch", None, "training without a compiler, torch exports"),
    ("casadi", None, "CasADi exports"),
    ("onnx", None, "ONNX exports"),
    *((p.name, p.extra, p.purpose) for p in PACKAGES.values()),
    ("matplotlib", "plot", "draws simulations"),
    ("pyarrow", "parquet", "reads Parquet"),
    ("scipy", "mat", "reads MATLAB files"),
    ("h5py", "hdf5", "reads HDF5 and MATLAB 7.3 files"),
    ("asammdf", "mdf", "reads MDF"),
    ("rosbags", "ros", "reads ROS bags"),
    ("tensorboard", "tensorboard", "curves of trainings"),
    ("ziglang", "zig", "a C compiler as a package"),
)


def installation() -> Iterator[InstalledPart]:
    """Every part, looked up without importing it."""
    yield InstalledPart("msnn", "", __version__)
    yield InstalledPart(
        "python", "", f"{platform.python_version()} on {platform.platform(terse=True)}"
    )
    yield _compiler()
    for package, extra, purpose in _PACKAGES:
        install = f"pip install {package}" if extra is None else f"pip install 'msnn[{extra}]'"
        yield InstalledPart(package, purpose, _version(package), install)


def _compiler() -> InstalledPart:
    purpose = "native training kernels, tests of exported C"
    try:
        command = find_compiler()
    except CompilerMissingError:
        return InstalledPart(
            "C compiler", purpose, None, "apt install gcc, or pip install 'msnn[zig]'"
        )
    return InstalledPart("C compiler", purpose, " ".join(command))


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None

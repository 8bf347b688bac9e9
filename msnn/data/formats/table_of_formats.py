"""Lists the data file formats by suffix, and the packages required to read each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from compiler.ir.program import UsedPlugin
from msnn.errors.failures import MissingExtraError, MissingPluginError
from msnn.packages import (
    ASAMMDF,
    H5PY,
    NPTDMS,
    OPENPYXL,
    PYARROW,
    PYULOG,
    ROSBAGS,
    SCIPY,
    OptionalPackage,
)
from spec_schema import registry
from spec_schema.errors.plugins import other_version
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import look_up, plugins_with

if TYPE_CHECKING:
    from msnn.data.formats.plugin_file import PluginReader
    from msnn.data.formats.table import ColumnTable, Streams, WantedColumns
    from msnn.data.formats.text.csv_header import Dialect
    from spec_schema.diagnostics.diagnostic import Diagnostic

    Reader = Callable[[Path, str, WantedColumns, Dialect], ColumnTable | Streams]
    """(path, its name in messages, what is wanted, layout of text) → columns; raises SpecError."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFormat:
    """One file format. The reader is the function `read` of `module`, imported on first use, or
    that of a plug-in.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str = ""
    plugin: PluginReader | None = None
    packages: tuple[OptionalPackage, ...] = ()
    is_text: bool = False
    is_isolated: bool = False
    """True if a separate process reads it, because a malformed file may crash its compiled
    reader.
    """
    text_keys: tuple[str, ...] = ()
    """The keys of `csv:` that apply to this format."""
    keeps_time: bool = False
    """True if the file itself stores the time of each value."""

    @property
    def has_lines(self) -> bool:
        """True if a message may show a line of the file."""
        return self.is_text or (self.plugin is not None and self.plugin.is_text)

    @property
    def reader(self) -> Reader:
        if self.is_isolated:
            from msnn.data.formats.isolation.reader import isolated

            return isolated(self.plugin or self.module)
        if self.plugin is not None:
            return self.plugin
        # each reader brings its library, of which some take a second to load
        return import_module(self.module).read

    @property
    def missing(self) -> tuple[OptionalPackage, ...]:
        """The required packages that are not installed."""
        return tuple(package for package in self.packages if not package.is_installed)


TEXT = FileFormat(
    name="CSV",
    suffixes=(".csv", ".txt", ".tsv", ".dat"),
    module="msnn.data.formats.text.csv_file",
    is_text=True,
    text_keys=("delimiter", "decimal", "thousands", "comment", "header", "skip"),
)

FORMATS = (
    TEXT,
    FileFormat(
        name="Excel",
        suffixes=(".xlsx",),
        module="msnn.data.formats.text.xlsx_file",
        packages=(OPENPYXL,),
        text_keys=("comment", "header", "skip"),
    ),
    FileFormat(name="NPZ", suffixes=(".npz",), module="msnn.data.formats.arrays.npz_file"),
    FileFormat(
        name="Parquet",
        suffixes=(".parquet",),
        module="msnn.data.formats.arrays.parquet_file",
        packages=(PYARROW,),
    ),
    FileFormat(
        name="MAT",
        suffixes=(".mat",),
        module="msnn.data.formats.arrays.mat_file",
        is_isolated=True,
        packages=(SCIPY, H5PY),
    ),
    FileFormat(
        name="HDF5",
        suffixes=(".h5", ".hdf5"),
        module="msnn.data.formats.arrays.hdf5_file",
        is_isolated=True,
        packages=(H5PY,),
    ),
    FileFormat(
        name="MDF",
        suffixes=(".mf4", ".mdf"),
        module="msnn.data.formats.streams.mdf_file",
        is_isolated=True,
        packages=(ASAMMDF,),
        keeps_time=True,
    ),
    FileFormat(
        name="ROS bag",
        suffixes=(".bag", ".db3", ".mcap"),
        module="msnn.data.formats.streams.rosbag_file",
        is_isolated=True,
        packages=(ROSBAGS,),
        keeps_time=True,
    ),
    FileFormat(
        name="TDMS",
        suffixes=(".tdms",),
        module="msnn.data.formats.streams.tdms_file",
        is_isolated=True,
        packages=(NPTDMS,),
        keeps_time=True,
    ),
    FileFormat(
        name="ULog",
        suffixes=(".ulg", ".ulog"),
        module="msnn.data.formats.streams.ulog_file",
        is_isolated=True,
        packages=(PYULOG,),
        keeps_time=True,
    ),
)
SUFFIXES = tuple(suffix for format in FORMATS for suffix in format.suffixes)
_PLAIN_TEXT = (".asc", ".data", ".dlm", ".log", ".out", ".prn", ".tab", ".text")
"""Further suffixes of text files; a plug-in may read them."""


def format_of(path: Path | str) -> FileFormat:
    """The format of a file, of ours or of a plug-in; an unknown suffix means text."""
    suffix = Path(path).suffix.lower()
    ours = next((format for format in FORMATS if suffix in format.suffixes), None)
    return ours or _format_of_plugin(suffix) or TEXT


def warnings_of_plugins(path: Path | str) -> tuple[Diagnostic, ...]:
    """Warnings about omitted plug-ins that concern the suffix of the file.

    All of them if no format has the suffix; those about this suffix if another plug-in has it.
    """
    suffix = Path(path).suffix.lower()
    if suffix in ("", *SUFFIXES):
        return ()
    plugins = look_up()
    return plugins.refused.get(("format", suffix), ()) if _has_plugin(suffix) else plugins.warnings


def unread_suffix(path: Path | str) -> str | None:
    """The suffix of a file that is taken as text because no format and no plug-in has it.

    None for suffixes that text files commonly have.
    """
    suffix = Path(path).suffix.lower()
    is_known = suffix in ("", *SUFFIXES, *_PLAIN_TEXT) or _has_plugin(suffix)
    return None if is_known else suffix


def format_plugins(paths: Iterable[Path | str]) -> dict[str, UsedPlugin]:
    """The plug-ins that read these files, by suffix."""
    suffixes = sorted({Path(path).suffix.lower() for path in paths} - {"", *SUFFIXES})
    if suffixes:
        look_up()
    return {
        suffix: UsedPlugin(plugin.package, plugin.version)
        for suffix in suffixes
        for plugin in plugins_with([("format", suffix)])
    }


def require_formats(
    paths: Iterable[Path | str], recorded: Mapping[str, UsedPlugin | None]
) -> Iterator[Diagnostic]:
    """Warnings (W0956) about files that another version of a plug-in reads than in a run.

    `recorded` has the plug-in for each suffix of the run's data, None for our own formats. Raises
    MissingPluginError if a plug-in of the run is not installed, or does not read these files.
    """
    by_suffix = {Path(path).suffix.lower(): str(path) for path in paths}
    now = format_plugins(by_suffix.values())
    for suffix in by_suffix.keys() & recorded.keys():
        then, installed = recorded[suffix], now.get(suffix)
        if then == installed:
            continue
        if then is not None and (installed is None or installed.package != then.package):
            plugins = look_up()
            version = next((p.version for p in plugins.found if p.package == then.package), None)
            reason = plugins.failed.get(then.package, "")
            if version is not None:
                reason = f"the installed version {version} does not read `{suffix}` files"
            raise MissingPluginError(then.package, then.version, by_suffix[suffix], reason)
        assert installed is not None
        version = None if then is None else then.version
        what = f"the `{suffix}` files of the run were read"
        yield other_version(what, installed.package, version, installed.version)


def _has_plugin(suffix: str) -> bool:
    look_up()
    return suffix in registry.FORMATS


def _format_of_plugin(suffix: str) -> FileFormat | None:
    if not suffix:
        return None
    look_up()
    line = registry.FORMATS.get(suffix)
    if line is None:
        return None
    from msnn.data.formats.plugin_file import plugin_reader

    return FileFormat(
        name=line.name,
        suffixes=line.suffixes,
        plugin=plugin_reader(line, suffix),
        is_isolated=line.is_isolated,
    )


def require_reader(path: Path | str) -> None:
    """Raises MissingExtraError if a package that reads this file is not installed."""
    format = format_of(path)
    if format.missing:
        names = " and ".join(package.name for package in format.missing)
        what = f"{names}, which reads {format.name} files such as {path},"
        raise MissingExtraError(what, format.missing[0].install)

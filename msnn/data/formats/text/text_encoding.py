"""Identifies files that are not UTF-8 text, and suggests a conversion."""

from __future__ import annotations

import shlex
import zipfile
from pathlib import Path

from msnn.errors.data.files import spreadsheet, unreadable_file
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

_MARKS = {b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
"""Byte order marks, by which a file states its encoding."""
_EUROPEAN = "WINDOWS-1252"
"""The encoding that European spreadsheets and loggers write without a mark."""
_CONTROLS = frozenset(range(32)) - frozenset(b"\t\n\v\f\r\x1a\x1b")
"""Bytes that texts of no encoding without marks contain."""
_COMPRESSED = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
}
"""First bytes of compressed files, and the program that unpacks them."""
_OTHERS = {
    b"\x89HDF\r\n\x1a\n": ("HDF5", ".h5"),
    b"PAR1": ("Parquet", ".parquet"),
    b"MATLAB 5.0": ("MAT", ".mat"),
    b"MDF     ": ("MDF", ".mf4"),
    b"#ROSBAG": ("ROS bag", ".bag"),
    b"SQLite format 3": ("ROS bag", ".db3"),
    b"\x89MCAP0": ("ROS bag", ".mcap"),
    b"TDSm": ("TDMS", ".tdms"),
    b"ULog\x01\x12\x35": ("ULog", ".ulg"),
}
"""First bytes of formats with their own readers, and the suffix that selects the reader."""
_SUFFIXES = {
    ".h5": (".h5", ".hdf5", ".mat"),
    ".mf4": (".mf4", ".mdf"),
    ".ulg": (".ulg", ".ulog"),
}
"""Suffixes that select the same reader as that of `_OTHERS`."""
_DAMAGED = "copy the file again, or open it with the program that wrote it and write it anew"
_OLD_WORKBOOK = b"\xd0\xcf\x11\xe0"
_ZIP = b"PK\x03\x04"
_WITHOUT_READER = {
    b"\x93NUMPY": ("NPY", "save its columns under their names by `numpy.savez`, in `….npz`"),
    b"ARROW1": ("Feather", 'save it as Parquet: `frame.to_parquet("….parquet")`'),
    b"CDF": ("NetCDF 3", "convert it to NetCDF 4 by `nccopy -k nc4`, in a file `….h5`"),
}


def refuse_other_formats(path: Path, shown: str) -> None:
    """Raises SpecError for a file in a format other than text, regardless of its name."""
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError:
        return  # what is wrong with it the reader says
    if begin.startswith(_OLD_WORKBOOK):
        raise SpecError((spreadsheet(shown),))
    if begin.startswith(_ZIP):
        raise SpecError((_archive(path, shown),))
    for magic, program in _COMPRESSED.items():
        if begin.startswith(magic):
            raise SpecError((_compressed(shown, program),))
    for magic, (format, suffix) in _OTHERS.items():
        if begin.startswith(magic):
            repair = f"give it a name that ends in `{suffix}`"
            raise SpecError((unreadable_file(shown, f"its format is {format}", repair),))
    for magic, (format, repair) in _WITHOUT_READER.items():
        if begin.startswith(magic):
            raise SpecError((unreadable_file(shown, f"its format is {format}", repair),))


def other_name(path: Path) -> str | None:
    """The repair for a file that the reader of its suffix rejects: a name that fits its format.

    None if the format cannot be identified.
    """
    try:
        with path.open("rb") as file:
            begin = file.read(1024)
    except OSError:
        return None
    for magic, (format, suffix) in _OTHERS.items():
        if begin.startswith(magic):
            if path.suffix.lower() in _SUFFIXES.get(suffix, (suffix,)):
                return _DAMAGED
            return f"its format is {format}: give it a name that ends in `{suffix}`"
    if begin.startswith(_ZIP):
        return None
    is_text = bool(begin) and all(byte >= 32 or byte in b"\t\r\n" for byte in begin)
    return "it is text: give it a name that ends in `.csv`" if is_text else None


def not_utf8(path: Path, shown: str, error: UnicodeDecodeError) -> Diagnostic:
    """Diagnostic E0802, with the command that converts the file if it is text."""
    with path.open("rb") as file:
        begin = file.read(4096)
    # a guess that the message shows as a command, not one that is read by
    encoding = _MARKS.get(begin[:2], _EUROPEAN)
    if begin[:2] not in _MARKS and any(byte in _CONTROLS for byte in begin):
        reason = "it is neither text nor of a format that its name or its first bytes show"
        known = [suffix for _, suffix in _OTHERS.values()]
        repair = f"export it to CSV, or to a file that ends in {', '.join(known)}"
        return unreadable_file(shown, reason, repair)
    reason = f"it is not UTF-8 text (byte {error.start} is {error.object[error.start]:#04x})"
    name = shlex.quote(shown)
    repair = (
        f"save it as `CSV UTF-8`, or convert it: `iconv -f {encoding} -t UTF-8 {name} > utf8.csv`"
    )
    return unreadable_file(shown, reason, repair)


def _compressed(shown: str, program: str) -> Diagnostic:
    repair = f"unpack it: `{program} -dc {shlex.quote(shown)} > unpacked.csv`"
    return unreadable_file(shown, f"it is compressed by {program}", repair)


def _archive(path: Path, shown: str) -> Diagnostic:
    """The diagnostic for a ZIP archive, which may be a workbook or an archive of numpy."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return spreadsheet(shown)
    if any(name.startswith("xl/") or name == "content.xml" for name in names):
        return spreadsheet(shown)
    if names and all(name.endswith(".npy") for name in names):
        repair = "give it a name that ends in `.npz`"
        return unreadable_file(shown, "it is an archive of numpy.savez", repair)
    repair = f"unpack it: `unzip {shlex.quote(shown)}`"
    return unreadable_file(shown, "it is a ZIP archive", repair)

"""Makes the files of a release: sdist, wheel made of it, bill of materials, hashes and notes.

    python .ci/release.py            a dry run, as CI does: everything but the tag is checked
    python .ci/release.py --tagged   the same for the commit that the tag v<version> names

Files go to dist/. They are the same bytes for the same commit: times are those of the commit.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

from sbom import text_of_bill

ROOT = Path(__file__).resolve().parent.parent
VERSION_FILE = ROOT / "spec_schema" / "version.py"
CHANGELOG = ROOT / "CHANGELOG.md"
HASHES = "SHA256SUMS"
NOTES = "NOTES.md"


class ReleaseError(Exception):
    """What a release lacks, in one sentence for the person who makes it."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Make what a release hands out.")
    parser.add_argument("--tagged", action="store_true", help="the tag must name this commit")
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    given = parser.parse_args()
    try:
        version = released_version(VERSION_FILE.read_text(encoding="utf-8"))
        notes = release_notes(CHANGELOG.read_text(encoding="utf-8"), version, tagged=given.tagged)
        if given.tagged:
            check_tag(version)
        files = build(given.out, version)
        check_contents(files, version)
        materials = given.out / f"msnn-{version}.cdx.json"
        materials.write_text(text_of_bill(version), encoding="utf-8")
        files.append(materials)
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    (given.out / NOTES).write_text(notes, encoding="utf-8")
    (given.out / HASHES).write_text(hashes(files), encoding="utf-8")
    for file in (*files, given.out / HASHES, given.out / NOTES):
        print(f"release: {file.name}, {file.stat().st_size} bytes")
    return 0


def released_version(text: str) -> str:
    """The version in version.py, which must be one that installers can order (PEP 440)."""
    found = re.search(r'^__version__ = "([^"]+)"$', text, re.M)
    if found is None or re.fullmatch(r"\d+\.\d+\.\d+(?:(?:a|b|rc)\d+)?", found[1]) is None:
        raise ReleaseError(f"{VERSION_FILE.name} has no version such as 1.2.3 or 1.2.3rc1")
    return found[1]


def release_notes(changelog: str, version: str, *, tagged: bool) -> str:
    """The section of the changelog for this version; dated where it is released."""
    found = re.search(
        rf"^## {re.escape(version)} \((.+?)\)\n(.*?)(?=^## |\Z)", changelog, re.M | re.S
    )
    if found is None or not found[2].strip():
        raise ReleaseError(f"CHANGELOG.md has no section `## {version} (…)` with something in it")
    if tagged and re.fullmatch(r"\d{4}-\d\d-\d\d", found[1]) is None:
        raise ReleaseError(f"write the day of the release: `## {version} (2026-01-31)`")
    return f"# msnn {version}\n\n{found[2].strip()}\n"


def check_tag(version: str) -> None:
    """The tag must name this commit, and nothing may differ from it."""
    if git("status", "--porcelain"):
        raise ReleaseError("there are changes that no commit has")
    if f"v{version}" not in git("tag", "--points-at", "HEAD").split():
        raise ReleaseError(f"this commit has no tag v{version}: git tag -a v{version}")


def build(out: Path, version: str) -> list[Path]:
    """The sdist of the checkout, and the wheel of what stands in the sdist."""
    clear(out)
    when = git("log", "-1", "--format=%ct")
    environment = {**os.environ, "SOURCE_DATE_EPOCH": when}
    call = [sys.executable, "-m", "hatchling", "build", "--directory", str(out.resolve())]
    subprocess.run([*call, "-t", "sdist"], cwd=ROOT, env=environment, check=True, stdout=2)
    sdist = out / f"msnn-{version}.tar.gz"
    if not sdist.is_file():
        raise ReleaseError(f"the build made no {sdist.name}")
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        inside = Path(folder) / f"msnn-{version}"
        subprocess.run([*call, "-t", "wheel"], cwd=inside, env=environment, check=True, stdout=2)
    return [sdist, *out.glob("*.whl")]


def clear(out: Path) -> None:
    """An empty folder; what a release has not made there is nobody's to take away."""
    out.mkdir(parents=True, exist_ok=True)
    strangers = sorted(path.name for path in out.iterdir() if not is_ours(path))
    if strangers:
        raise ReleaseError(f"{out} has {strangers[0]}, which no release made: take another folder")
    for path in out.iterdir():
        path.unlink()


def is_ours(path: Path) -> bool:
    """Whether a release writes a file of this name."""
    made = path.name in (HASHES, NOTES, ".gitignore") or re.fullmatch(
        r"msnn-[^-]+(\.tar\.gz|-py3-none-any\.whl|\.cdx\.json)", path.name
    )
    return bool(made) and path.is_file()


def check_contents(files: list[Path], version: str) -> None:
    """The wheel must say this version, carry the licence and the types, and claim one name."""
    sdist, wheel = files
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        about = f"msnn-{version}.dist-info"
        metadata = archive.read(f"{about}/METADATA").decode()
    if f"\nVersion: {version}\n" not in metadata:
        raise ReleaseError(f"{wheel.name} says another version than {version}")
    with tarfile.open(sdist) as archive:
        inside = [path.partition("/")[2] for path in archive.getnames() if path.endswith(".py")]
    code = [path if path.startswith("msnn/") else f"msnn/{path}" for path in inside if "/" in path]
    for wanted in (f"{about}/licenses/LICENSE", "msnn/py.typed", *code):
        if wanted not in names:
            raise ReleaseError(f"{wheel.name} lacks {wanted}")
    strangers = {name.partition("/")[0] for name in names} - {"msnn", about}
    if strangers:
        raise ReleaseError(f"{wheel.name} claims {', '.join(sorted(strangers))} beside msnn")
    with tarfile.open(sdist) as archive:
        if f"msnn-{version}/CHANGELOG.md" not in archive.getnames():
            raise ReleaseError(f"{sdist.name} lacks CHANGELOG.md")


def hashes(files: list[Path]) -> str:
    """Lines that `sha256sum --check` reads."""
    return "".join(f"{hashlib.sha256(f.read_bytes()).hexdigest()}  {f.name}\n" for f in files)


def git(*arguments: str) -> str:
    found = subprocess.run(
        ["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True
    )
    return found.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())

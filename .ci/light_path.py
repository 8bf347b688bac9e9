"""Walks the path of a new user with every Python that msnn is for: a light install, C that runs.

Each interpreter that is found on PATH or among pyenv's gets an environment of its own; the weights
and the C must be the same with all of them. Those that are not here are named.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VERSIONS = ("3.11", "3.12", "3.13")
COMMANDS = (
    ("init", "plant"),
    ("check", "plant/plant.msnn.yaml"),
    ("train", "plant/plant.msnn.yaml", "--out", "runs"),
    ("validate", "plant/plant.msnn.yaml", "--runs", "runs"),
    ("export", "plant/plant.msnn.yaml", "--runs", "runs", "--out", "build", "--check"),
)


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
        subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
        (wheel,) = folder.glob("*.whl")
        found = {version: interpreter(version) for version in VERSIONS}
        with ThreadPoolExecutor() as pool:  # each waits for servers of packages most of the time
            walks = {
                version: pool.submit(walk, python, wheel, folder / version)
                for version, python in found.items()
                if python is not None
            }
            made: dict[str, dict[str, bytes]] = {}
            for version in VERSIONS:
                if version not in walks:
                    print(f"light path: Python {version} is not here")
                    continue
                made[version] = walks[version].result()
                print(f"light path: Python {version} works")
    first, *others = made
    different = [version for version in others if made[version] != made[first]]
    for version in different:
        files = sorted(set(made[first]) ^ set(made[version])) or [
            name for name in made[first] if made[first][name] != made[version][name]
        ]
        print(f"light path: {', '.join(files)} differ in Python {first} and {version}")
    return 1 if different else 0


def interpreter(version: str) -> str | None:
    """The command of a Python of that version, if one is here that runs."""
    for command in candidates(version):
        asked = [command, "-c", "import sys, venv; print('%d.%d' % sys.version_info[:2])"]
        answer = subprocess.run(asked, capture_output=True, text=True, check=False)
        if answer.stdout.strip() == version:
            return command
    return None


def candidates(version: str) -> Iterator[str]:
    on_path = shutil.which(f"python{version}")
    if on_path is not None:
        yield on_path
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    yield from map(str, sorted(pyenv.glob(f"versions/{version}.*/bin/python")))


def walk(python: str, wheel: Path, folder: Path) -> dict[str, bytes]:
    """Installs the wheel alone, runs every command, and returns what must not depend on Python."""
    environment = folder / "environment"
    binaries = environment / "bin"
    # A pip of its own took longer to install than all that it installs, and bytecode of what no
    # command imports as long again.
    subprocess.run([python, "-m", "venv", "--without-pip", environment], check=True)
    pip = [sys.executable, "-m", "pip", "--python", binaries / "python"]
    subprocess.run([*pip, "install", "--quiet", "--no-compile", wheel], check=True)
    for command in COMMANDS:
        said = subprocess.run(
            [binaries / "msnn", *command], cwd=folder, capture_output=True, text=True, check=False
        )
        if said.returncode:
            print(said.stdout, said.stderr, sep="\n", file=sys.stderr)
            raise SystemExit(f"light path: `msnn {' '.join(command)}` failed with {python}")
    sources = [*(folder / "build" / "c").rglob("*.[ch]")]
    if not sources:
        raise SystemExit(f"light path: no C was exported with {python}")
    parameters = folder / "runs" / "plant" / "latest" / "weights.safetensors"
    return {path.name: path.read_bytes() for path in (*sources, parameters)}


if __name__ == "__main__":
    sys.exit(main())

"""Makes the environment in .venv from requirements.lock, with the standard library alone.

Run by `make` with the Python that the environment shall use. A stamp is written only after its
step has succeeded, so an interrupted run starts that step again, and a finished one returns at
once.
"""

import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from uv_settings import uv_environment

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = ROOT / ".venv"
PYTHON = ENVIRONMENT / "bin" / "python"
LOCK = ROOT / "requirements.lock"
PROJECT = ROOT / "pyproject.toml"
VENV_PACKAGE = "python3.11-venv"
WITH_PIP = (
    "install",
    "--require-hashes",
    "--disable-pip-version-check",
    "--quiet",
    "--progress-bar=off",
)


class SetUpError(Exception):
    """What stopped the set-up, in one sentence for the person who ran it."""


def main() -> int:
    try:
        check_python(sys.version_info[:3])
        # An environment outlives neither its interpreter nor its folder, so both are in the key.
        once("dependencies", digest(LOCK, sys.version, str(ROOT)), install_dependencies)
        once("package", digest(PROJECT), install_package)
    except SetUpError as error:
        print(f"set-up: {error}", file=sys.stderr)
        return 2
    except subprocess.CalledProcessError as error:
        print(f"set-up: this command failed: {' '.join(error.cmd)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("set-up: interrupted; run make again to go on", file=sys.stderr)
        return 130
    return 0


def check_python(version: tuple[int, int, int]) -> None:
    if version[:2] != (3, 11):
        found = ".".join(str(part) for part in version)
        raise SetUpError(
            f"requirements.lock is made for Python 3.11 and this is {found}; "
            "name another with make PYTHON=/path/to/python3.11."
        )


def once(name: str, key: str, step: Callable[[], None]) -> None:
    """Runs `step` unless its stamp holds `key`."""
    stamp = ENVIRONMENT / f"{name}.stamp"
    if stamp.is_file() and stamp.read_text() == key:
        return
    stamp.unlink(missing_ok=True)
    step()
    unfinished = stamp.with_suffix(".unfinished")
    unfinished.write_text(key)
    unfinished.replace(stamp)


def digest(path: Path, *more: str) -> str:
    sha = hashlib.sha256(path.read_bytes())
    for text in more:
        sha.update(b"\0" + text.encode())
    return sha.hexdigest()


def install_dependencies() -> None:
    """A fresh environment with exactly the locked packages; half an older one is never kept."""
    if Path(sys.prefix).resolve() == ENVIRONMENT:
        raise SetUpError("the Python of .venv cannot make .venv anew; run deactivate first.")
    pip = fresh_environment()
    tell("installing requirements.lock into .venv (the first time some gigabytes, mostly torch)")
    if install_with_uv(pip):
        return
    call(
        *fresh_environment(),
        *WITH_PIP,
        "--no-compile",  # of the bytecode of all these files a tenth is ever used
        f"--requirement={LOCK}",
    )


def install_with_uv(pip: list[str]) -> bool:
    """Whether uv, which is one of the locked packages, has installed them all.

    It takes half of the processor time that pip takes, on all cores, and while it waits for
    servers. Its hashes and its sources of packages are pip's.
    """
    environment = uv_environment(pip)
    if environment is None:
        return False
    uv_alone = ENVIRONMENT / "uv.lock"
    uv_alone.write_text(locked("uv"))
    try:
        call(*pip, *WITH_PIP, "--no-deps", f"--requirement={uv_alone}")
        call(
            str(ENVIRONMENT / "bin" / "uv"),
            "--no-config",
            "--quiet",
            "pip",
            "install",
            f"--python={PYTHON}",
            "--require-hashes",
            # the hashes say which file is meant, whichever of pip's indexes has it
            "--index-strategy=unsafe-best-match",
            f"--requirements={LOCK}",
            environment=environment,
        )
    except (OSError, subprocess.CalledProcessError) as error:
        tell(f"uv has not installed requirements.lock, so pip does: {error}")
        return False
    return True


def locked(package: str) -> str:
    """The lines of the lock that pin one package."""
    found = re.search(rf"^{package}==.*\n(?:[ ].*\n)*", LOCK.read_text(), re.MULTILINE)
    if found is None:
        raise SetUpError(f"requirements.lock has no {package}; run make lock.")
    return found[0]


def install_package() -> None:
    """msnn itself, from this folder; its build tools are in the lock, so nothing is fetched."""
    tell("installing msnn from this folder into .venv")
    call(
        str(PYTHON),
        "-m",
        "pip",
        "install",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--disable-pip-version-check",
        "--quiet",
        f"--editable={ROOT}",
    )


def fresh_environment() -> list[str]:
    """Makes .venv anew; returns the pip command that installs into it.

    Debian keeps ensurepip, which puts pip into an environment, in a package of its own. Without
    it a pip beside this Python can serve the environment from outside; without that, too, the
    package is installed.
    """
    if ENVIRONMENT.exists():
        shutil.rmtree(ENVIRONMENT)
    if not has("ensurepip") and not has("pip"):
        install_debian_package(VENV_PACKAGE)
    if has("ensurepip"):
        call(sys.executable, "-m", "venv", str(ENVIRONMENT))
        return [str(PYTHON), "-m", "pip"]
    call(sys.executable, "-m", "venv", "--without-pip", str(ENVIRONMENT))
    return [sys.executable, "-m", "pip", "--python", str(PYTHON)]


def has(module: str) -> bool:
    importlib.invalidate_caches()
    return importlib.util.find_spec(module) is not None


def install_debian_package(package: str) -> None:
    command = f"apt-get install {package}"
    rights = administrator()
    if shutil.which("apt-get") is None or rights is None:
        raise SetUpError(f"this Python has neither pip nor ensurepip; run: sudo {command}")
    tell(f"this Python has neither pip nor ensurepip: {command}")
    quietly = ("--quiet=2", "--option=Dpkg::Use-Pty=0")
    call(*rights, "apt-get", "update", *quietly)
    call(*rights, "env", "DEBIAN_FRONTEND=noninteractive", *command.split(), "--yes", *quietly)
    if not has("ensurepip"):
        raise SetUpError(f"{command} was of no use to {sys.executable}; name another with PYTHON=")


def administrator() -> list[str] | None:
    """The words before a command that needs root; None where that would need a password."""
    if os.geteuid() == 0:
        return []
    sudo = shutil.which("sudo")
    if sudo is None:
        return None
    free = subprocess.run([sudo, "-n", "true"], capture_output=True, check=False)
    return [sudo, "-n"] if free.returncode == 0 else None


def call(*command: str, environment: dict[str, str] | None = None) -> None:
    subprocess.run(command, check=True, env=environment)


def tell(text: str) -> None:
    print(f"set-up: {text}", flush=True)


if __name__ == "__main__":
    sys.exit(main())

"""The option `--accept`, and what every test runs under."""

import gc
import os
import signal
import sys
from collections.abc import Generator
from pathlib import Path

# Before numpy is loaded: its threads take a core each to wait for small products, beside the other
# tests that run, and made seven times the work of a fit of 60,000 rows.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from msnn.simulation.engines.kernel_check import NO_FALLBACK
from tests.command_server import commands
from tests.effort import set_effort


def pytest_configure() -> None:
    """What is so for all processes that tests start, the workers among them."""
    # images for containers often forbid bytecode: each process compiled all that it imports anew
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    # what a shell starts behind a `&` ignores Ctrl-C
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection() -> None:
    """Hardly anything of what is collected becomes free; walks through it took a fifth."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Walking through a million objects of modules and items again and again took an eighth.

    A test makes many objects and hardly any cycles: a seventieth of the walks saved a twentieth.
    """
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before fixtures of any scope are made."""
    set_effort(item.path)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--accept",
        action="store_true",
        help="write the golden files as the product writes them now; then read git diff",
    )


@pytest.fixture
def accept(request: pytest.FixtureRequest) -> bool:
    """Whether golden files are to be written instead of compared."""
    return bool(request.config.getoption("--accept"))


@pytest.fixture(autouse=True)
def _no_mistake_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel of ours that is wrong or cannot be made fails a test, also one that runs msnn."""
    monkeypatch.setenv(NO_FALLBACK, "1")


@pytest.fixture
def goes_on_without_kernels(
    _no_mistake_is_passed_over: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For tests of what users see then."""
    monkeypatch.delenv(NO_FALLBACK)


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    """A folder with a command `msnn` that has nothing to import."""
    with commands(tmp_path_factory.mktemp("commands")) as folder:
        yield folder

"""uv is told what pip's configuration says, or is not used."""

import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.ci.scripts import script


@pytest.fixture
def settings(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return script("uv_settings", monkeypatch)


def test_the_file_that_pip_reads_is_read(
    settings: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By pip itself: an index with a percent sign in it, and two lines of others."""
    file = tmp_path / "pip.conf"
    file.write_text(
        "[global]\n"
        "index-url = https://name:p%40ss@one.invalid/simple\n"
        "trusted-host = one.invalid\n"
        "cert = /etc/one.pem\n"
        "timeout = 20\n"
        "[install]\n"
        "extra-index-url = https://two.invalid/simple\n"
        "    https://three.invalid/simple\n"
        "find-links = /wheels /more\n"
        "[download]\n"
        "index-url = https://download.invalid/simple\n",
        encoding="utf-8",
    )
    for name in [name for name in os.environ if name.startswith(("PIP_", "UV_", "SSL_"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", str(file))
    monkeypatch.setenv("PIP_DEFAULT_TIMEOUT", "180")
    wanted = settings.uv_environment([sys.executable, "-m", "pip"])
    assert {name: value for name, value in wanted.items() if name not in os.environ} == {
        "UV_DEFAULT_INDEX": "https://name:p%40ss@one.invalid/simple",
        "UV_INDEX": "https://two.invalid/simple https://three.invalid/simple",
        "UV_FIND_LINKS": "/wheels,/more",
        "UV_INSECURE_HOST": "one.invalid",
        "UV_HTTP_TIMEOUT": "180",
        "SSL_CERT_FILE": "/etc/one.pem",
    }


def test_what_stands_for_installing_overrules(settings: ModuleType) -> None:
    listed = "global.index-url='https://one.invalid'\ninstall.index-url='https://two.invalid'"
    assert settings.translated(listed, {}) == {"UV_DEFAULT_INDEX": "https://two.invalid"}
    listed = f":env:.index-url='https://three.invalid'\n{listed}"
    assert settings.translated(listed, {}) == {"UV_DEFAULT_INDEX": "https://three.invalid"}


def test_settings_of_uv_are_none_of_pip(settings: ModuleType) -> None:
    given = {"UV_INDEX": "https://one.invalid", "UV_CACHE_DIR": "/cache", "HOME": "/home"}
    assert settings.translated("", given) == {"UV_CACHE_DIR": "/cache", "HOME": "/home"}


@pytest.mark.parametrize("setting", ["no-index", "only-binary", "constraint", "proxy"])
def test_of_what_uv_has_no_word_for_pip_is_left_to_itself(
    settings: ModuleType, setting: str
) -> None:
    assert settings.translated(f"global.quiet='1'\n:env:.{setting}='1'", {}) is None

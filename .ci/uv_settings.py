"""Says to uv what pip's configuration says, so that both fetch packages from the same places."""

import ast
import os
import subprocess
from collections.abc import Mapping, Sequence

_MEANING = {
    "cert": "SSL_CERT_FILE",
    "default-timeout": "UV_HTTP_TIMEOUT",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "index-url": "UV_DEFAULT_INDEX",
    "no-cache-dir": "UV_NO_CACHE",
    "timeout": "UV_HTTP_TIMEOUT",
    "trusted-host": "UV_INSECURE_HOST",
}
"""Settings of pip by the variables that uv reads."""

_OF_PIP_ALONE = {
    "cache-dir",
    "config-file",
    "disable-pip-version-check",
    "no-color",
    "no-compile",
    "no-input",
    "no-python-version-warning",
    "no-warn-script-location",
    "progress-bar",
    "quiet",
    "require-virtualenv",
    "retries",
    "root-user-action",
    "verbose",
}
"""Settings that change neither where packages come from nor what is installed."""

_SECTIONS = ("global", "install", ":env:")
"""What `pip install` reads, from what is overruled to what overrules."""


def uv_environment(pip: Sequence[str]) -> dict[str, str] | None:
    """What uv runs under; None where pip is told something that uv has no variable for."""
    listed = subprocess.run(
        [*pip, "config", "list"], check=True, capture_output=True, text=True
    ).stdout
    return translated(listed, os.environ)


def translated(listed: str, environment: Mapping[str, str]) -> dict[str, str] | None:
    """The environment with the settings that `pip config list` printed, and none of uv's own."""
    wanted = {
        name: value
        for name, value in environment.items()
        if name == "UV_CACHE_DIR" or not name.startswith("UV_")
    }
    for section in _SECTIONS:
        for line in listed.splitlines():
            place, _, value = line.partition("=")
            found, _, name = place.rpartition(".")
            if found != section or name in _OF_PIP_ALONE:
                continue
            if name not in _MEANING:
                return None
            words = str(ast.literal_eval(value)).split()
            separator = "," if name == "find-links" else " "
            wanted[_MEANING[name]] = separator.join(words)
    return wanted

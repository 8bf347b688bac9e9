"""The plug-ins that a model was made with; refuses a file whose plug-in is not installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from msnn.errors.failures import MissingPluginError
from spec_schema.plugins import look_up


def require_plugins(versions: Mapping[str, str], file: str) -> None:
    """Raises MissingPluginError for the first package, by name, that is not installed or fails.

    `versions` are those that the file was made with. Others are accepted: the file says itself
    whether its format is known.
    """
    if not versions:
        return
    plugins = look_up()
    installed = {plugin.package for plugin in plugins.found}
    for package, version in sorted(versions.items()):
        if package not in installed:
            raise MissingPluginError(package, version, file, plugins.failed.get(package, ""))


def recorded_plugins(record: Mapping[str, Any]) -> dict[str, str]:
    """The packages of plug-ins in `run.json`, as untrusted input, with their versions."""
    plugins = record.get("plugins")
    items = cast("dict[str, Any]", plugins).items() if isinstance(plugins, dict) else ()
    return {package: str(version) for package, version in items}


def plugins_text(versions: Mapping[str, str]) -> str:
    """Package and version of each plug-in, and what is installed of it if that is another."""
    if not versions:
        return ""
    plugins = look_up()
    installed = {plugin.package: plugin.version for plugin in plugins.found}
    return ", ".join(
        f"{package} {version}{_difference(package, version, installed, plugins.failed)}"
        for package, version in versions.items()
    )


def _difference(
    package: str, version: str, installed: Mapping[str, str], failed: Mapping[str, str]
) -> str:
    if package in failed:
        return f" (it fails: {failed[package]})"
    if package not in installed:
        return f" (not installed: pip install {package})"
    now = installed[package]
    return "" if now == version else f" ({now} is installed)"

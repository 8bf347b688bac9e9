"""Refuses a file that was made with a plug-in which is not installed."""

from __future__ import annotations

from collections.abc import Mapping

from msnn.errors.failures import MissingPluginError
from spec_schema.plugins import look_up


def require_plugins(versions: Mapping[str, str], file: str) -> None:
    """Raises MissingPluginError for the first package, by name, that is not installed or fails.

    `versions` are those that the file was made with. Others are accepted: the file says itself
    whether its format is known.
    """
    if not versions:
        return
    installed = {plugin.package for plugin in look_up().found}
    for package, version in sorted(versions.items()):
        if package not in installed:
            raise MissingPluginError(package, version, file)

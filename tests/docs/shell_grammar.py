"""Reads lines of a shell that no test can run: their grammar, and the verbs and options of msnn."""

from __future__ import annotations

import re
import shlex
import subprocess

import typer.main

from msnn.cli.application import application


def wrong_in_shell(commands: str) -> str:
    """What is wrong with them, or nothing."""
    read = subprocess.run(
        ["bash", "-n", "-c", commands], capture_output=True, text=True, check=False
    )
    if read.returncode:
        return read.stderr
    verbs = typer.main.get_command(application()).commands  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownVariableType]
    for line in re.split(r"&&|\||\n", commands.replace("\\\n", "")):
        words = shlex.split(line, comments=True)
        if "-m" in words and words[words.index("-m") + 1 :][:1] == ["msnn"]:  # python, torchrun
            words = words[words.index("-m") + 1 :]
        if len(words) < 2 or words[0] != "msnn":
            continue
        if words[1] not in verbs:
            return f"msnn has no verb {words[1]}"
        known = {name for each in verbs[words[1]].params for name in each.opts}  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        unknown = {word.partition("=")[0] for word in words[2:] if word.startswith("-")} - known
        if unknown - {"-"}:
            return f"msnn {words[1]} has no option {', '.join(sorted(unknown))}"
    return ""

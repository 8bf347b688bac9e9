"""Runs jobs of GitHub workflows in a folder: their shell steps as they are, caches as folders."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
OURS = "OWNER/msnn@v0.1.0"
_EXPRESSION = re.compile(r"\$\{\{(.*?)\}\}")


@dataclass
class Job:
    """What a job has said and done; one step that fails fails it."""

    log: str = ""
    outcomes: dict[str, str] = field(default_factory=dict[str, str])
    """By the name of each step, those of composite actions too."""
    summary: str = ""
    saved_last: list[dict[str, str]] = field(default_factory=list[dict[str, str]])
    """Caches that are saved when the job has ended well."""

    @property
    def passed(self) -> bool:
        return "failure" not in self.outcomes.values()

    @property
    def annotations(self) -> list[str]:
        return re.findall(r"^::(?:error|warning|notice).*$", self.log, re.MULTILINE)


@dataclass
class Host:
    """A code host with one repository: its checkout, its caches, and a home for its jobs."""

    workspace: Path
    caches: Path
    home: Path
    commands_folder: Path
    """With the `msnn` that is tested, as an installation has it."""

    def job(self, workflow: str, name: str, matrix: Mapping[str, str], ref: str, sha: str) -> Job:
        """Runs the steps of a job in the checkout as it is now, with a new home and no leavings."""
        self._tidy()
        text = (self.workspace / ".github" / "workflows" / workflow).read_text(encoding="utf-8")
        known = {"github.ref": ref, "github.sha": sha}
        known |= {f"matrix.{key}": value for key, value in matrix.items()}
        job = Job()
        steps = _Steps(self, job, known)
        steps.run(yaml.safe_load(text)["jobs"][name]["steps"])
        for cache in job.saved_last if job.passed else ():
            steps.save(cache)
        page = self.home / "summary.md"
        job.summary = page.read_text(encoding="utf-8") if page.is_file() else ""
        return job

    def commands(self, commands: str, environment: Mapping[str, str]) -> Job:
        """Runs lines of a shell as a job of one step."""
        self._tidy()
        job = Job()
        _Steps(self, job, {}).run([{"name": "commands", "run": commands, "env": environment}])
        return job

    def _tidy(self) -> None:
        shutil.rmtree(self.home, ignore_errors=True)
        self.home.mkdir(parents=True)
        for left in ("ci", "base"):
            shutil.rmtree(self.workspace / left, ignore_errors=True)


class _Steps:
    """The steps of a job, or of a composite action within one."""

    def __init__(self, host: Host, job: Job, known: dict[str, str]) -> None:
        self._host, self._job, self._known = host, job, known

    def run(self, steps: list[dict[str, Any]]) -> None:
        for step in steps:
            title = step.get("name", step.get("uses", ""))
            done = "skipped"
            if self._wanted(str(step.get("if", "success()"))):
                done = "success" if self._step(step) else "failure"
            self._job.outcomes[title] = done
            if "id" in step:
                self._known[f"steps.{step['id']}.outcome"] = done

    def _step(self, step: dict[str, Any]) -> bool:
        given = {key: self._filled(value) for key, value in step.get("with", {}).items()}
        match step.get("uses"):
            case None:
                return self._shell(step)
            case "actions/checkout@v4" | "actions/setup-python@v5":
                return True
            case "actions/cache@v4":
                self._job.saved_last.append(given)
                self._restore(given)
                return True
            case "actions/cache/restore@v4":
                self._restore(given)
                return True
            case "actions/cache/save@v4":
                self.save(given)
                return True
            case "actions/upload-artifact@v4":
                return any(self._path(given["path"]).iterdir())
            case uses if uses == OURS:
                return self._composite(given)
            case other:
                raise AssertionError(f"a step that this runner does not know: {other}")

    def _composite(self, given: dict[str, str]) -> bool:
        action = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
        assert given.keys() <= action["inputs"].keys()
        known = dict(self._known)
        for name, declared in action["inputs"].items():
            assert name in given or not declared.get("required", False), name
            known[f"inputs.{name}"] = given.get(name) or str(declared.get("default", ""))
        known["inputs.install"] = "no"  # what is tested is here
        _Steps(self._host, self._job, known).run(action["runs"]["steps"])
        return self._job.passed

    def _shell(self, step: dict[str, Any]) -> bool:
        outputs = self._host.home / "outputs"
        outputs.write_text("", encoding="utf-8")
        environment = {
            "PATH": f"{self._host.commands_folder}:{os.environ['PATH']}",
            "HOME": str(self._host.home),
            "PYTHONPATH": str(ROOT),
            "CI": "true",
            "GITHUB_OUTPUT": str(outputs),
            "GITHUB_STEP_SUMMARY": str(self._host.home / "summary.md"),
            **{key: self._filled(value) for key, value in step.get("env", {}).items()},
        }
        found = subprocess.run(
            ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", self._filled(step["run"])],
            cwd=self._host.workspace,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        self._job.log += found.stdout
        for line in outputs.read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition("=")
            self._known[f"steps.{step['id']}.outputs.{key}"] = value
        return found.returncode == 0

    def _restore(self, given: dict[str, str]) -> None:
        for key in (given["key"], *given.get("restore-keys", "").split()):
            kept = sorted(self._host.caches.glob(f"{key}*"), key=lambda path: path.stat().st_mtime)
            if kept:
                _copy(kept[-1], self._path(given["path"]))
                return

    def save(self, given: dict[str, str]) -> None:
        """Keeps a folder as a cache, which other jobs restore by its key or how that begins."""
        _copy(self._path(given["path"]), self._host.caches / given["key"])

    def _path(self, path: str) -> Path:
        return self._host.workspace / path.replace("~", str(self._host.home))

    def _filled(self, value: object) -> str:
        """The text with the value of each expression in it."""
        return _EXPRESSION.sub(lambda found: self._value(found[1].strip()), str(value))

    def _value(self, expression: str) -> str:
        if expression.startswith("'"):
            return expression.strip("'")
        assert re.fullmatch(r"(github|matrix|inputs|steps)(\.[\w-]+)+", expression), expression
        return self._known.get(expression, "")

    def _wanted(self, condition: str) -> bool:
        """Whether a step runs: all terms hold, and after a failure only where a function asks."""
        terms = list(self._terms(condition))
        functions = {"success()", "always()", "!cancelled()"}
        return all(self._holds(term) for term in terms) and (
            self._job.passed or bool(functions - {"success()"} & set(terms))
        )

    def _terms(self, condition: str) -> Iterator[str]:
        text = found[1] if (found := _EXPRESSION.fullmatch(condition)) else condition
        yield from (term.strip() for term in text.split("&&"))

    def _holds(self, term: str) -> bool:
        if term in ("success()", "always()", "!cancelled()"):
            return True
        left, sign, right = re.split(r"\s*(==|!=)\s*", term)
        return (self._value(left) == self._value(right)) is (sign == "==")


def _copy(source: Path, target: Path) -> None:
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(source, target, symlinks=True)

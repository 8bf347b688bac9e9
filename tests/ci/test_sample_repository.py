"""The sample repository is what its workflow says: two specs on main, then changes of them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import yaml

from tests.ci.workflow_runner import OURS, ROOT, Host, Job
from tests.cli.command_line import in_new_process
from tests.conditions import require_tool

SAMPLE = ROOT / "examples" / "ci"
WORKFLOW = "models.yml"
MAIN, CHANGE = "refs/heads/main", "refs/pull/7/merge"


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory, quick: Path) -> Host:
    """The repository on a code host, before anything has run."""
    require_tool("gcc", install="apt install gcc")
    folder = tmp_path_factory.mktemp("host")
    shutil.copytree(SAMPLE, folder / "models", ignore=shutil.ignore_patterns("ci", "base"))
    return Host(folder / "models", folder / "caches", folder / "home", quick)


def _specs() -> list[str]:
    workflow = yaml.safe_load((SAMPLE / ".github" / "workflows" / WORKFLOW).read_text())
    return workflow["jobs"]["model"]["strategy"]["matrix"]["spec"]


@pytest.fixture(scope="module")
def on_main(host: Host) -> dict[str, Job]:
    """A push to main: a job a spec."""
    host.caches.mkdir()
    return {spec: host.job(WORKFLOW, "model", {"spec": spec}, MAIN, "1" * 40) for spec in _specs()}


def _changed(host: Host, spec: str, **replaced: str) -> Job:
    """A pull request that changes values of a spec; the checkout is main's again after it."""
    file = host.workspace / "specs" / f"{spec}.msnn.yaml"
    text = file.read_text(encoding="utf-8")
    changed = text
    for key, value in replaced.items():
        changed, times = re.subn(rf"(?<=\b{key}: )[^,}}\n]+", value, changed, count=1)
        assert times == 1, key
    file.write_text(changed, encoding="utf-8")
    try:
        return host.job(WORKFLOW, "model", {"spec": spec}, CHANGE, "2" * 40)
    finally:
        file.write_text(text, encoding="utf-8")


def test_main_passes_and_every_step_has_run(host: Host, on_main: dict[str, Job]):
    assert sorted(on_main) == sorted(
        path.name.removesuffix(".msnn.yaml") for path in (SAMPLE / "specs").iterdir()
    )
    for spec, job in on_main.items():
        assert job.passed, job.log
        skipped = [step for step, outcome in job.outcomes.items() if outcome == "skipped"]
        assert skipped == ["Install msnn"]
        assert job.annotations == ["::notice::no run in base/runs to compare with"]
        assert f"## {spec}: every limit is kept" in job.summary
        assert (host.caches / f"kernels-{spec}-{'1' * 40}").is_dir()


def test_a_change_that_is_no_change_is_compared_and_passes(host: Host, on_main: dict[str, Job]):
    job = _changed(host, "heater", doc="electrical power")
    assert job.passed, job.log
    assert job.annotations == []
    verdict = "the same model: only its text differs, such as comments or layout"
    assert f"## heater: {verdict}; no metric is worse" in job.summary
    assert "| rmse |" in job.summary
    page = host.workspace / "ci" / "report.html"
    assert page.stat().st_size > 10_000
    assert list((host.workspace / "ci" / "export" / "c").rglob("heater.h"))
    before, after = (_kernels(host.caches / f"kernels-heater-{sha * 40}") for sha in "12")
    assert before == after, "a kernel was compiled although the cache has it"


def test_a_broken_limit_stands_at_its_line_and_ends_the_job(host: Host, on_main: dict[str, Job]):
    job = _changed(host, "motor", max="0.1 rad/s", epochs="1")
    assert not job.passed
    assert job.outcomes["Validate"] == "failure"
    assert job.outcomes["Export"] == "skipped"
    text = (SAMPLE / "specs" / "motor.msnn.yaml").read_text(encoding="utf-8")
    line = next(n for n, row in enumerate(text.splitlines(), 1) if "metric: rmse" in row)
    place = f"file=specs/motor.msnn.yaml,line={line},"
    broken = [said for said in job.annotations if f"title=E0870,{place}" in said]
    assert len(broken) == 1
    assert "the limit is ≤ 0.1 rad/s" in broken[0]
    worse = [said for said in job.annotations if f"title=E0871,{place}" in said]
    assert len(worse) == 1
    assert "## motor: a limit is broken" in job.summary
    assert "BROKEN" in job.summary
    assert 'failures="' in (host.workspace / "ci" / "limits.xml").read_text(encoding="utf-8")


def test_the_commands_for_any_host(host: Host, on_main: dict[str, Job]):
    page = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
    commands = "".join(re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL))
    base = host.caches / f"base-motor-{'1' * 40}" / "runs"
    said = host.commands(commands, {"BASE": str(base)})
    assert said.passed, said.log
    assert "the same; no metric is worse" in said.log


def test_the_hooks_take_the_specs_and_find_what_is_wrong(tmp_path: Path):
    listed = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    hooks = {hook["id"]: hook for hook in listed}
    used = yaml.safe_load((SAMPLE / ".pre-commit-config.yaml").read_text())["repos"][0]
    assert used["repo"].endswith(OURS.partition("@")[0])
    assert {hook["id"] for hook in used["hooks"]} == hooks.keys()
    files = [str(p.relative_to(SAMPLE)) for p in sorted(SAMPLE.rglob("*")) if p.is_file()]
    for hook in hooks.values():
        found = [file for file in files if re.search(hook["files"], file)]
        assert found == [f"specs/{spec}.msnn.yaml" for spec in _specs()]
        command, *arguments = hook["entry"].split()
        assert command == "msnn"
        assert in_new_process([*arguments, *found], SAMPLE).code == 0
    broken = tmp_path / "motor.msnn.yaml"
    text = (SAMPLE / "specs" / "motor.msnn.yaml").read_text(encoding="utf-8")
    broken.write_text(text.replace("gain*u", "gian*u"), encoding="utf-8")
    assert in_new_process([*hooks["msnn-check"]["entry"].split()[1:], str(broken)], tmp_path).code


def _kernels(cache: Path) -> set[str]:
    return {str(path.relative_to(cache)) for path in cache.rglob("*.so")}

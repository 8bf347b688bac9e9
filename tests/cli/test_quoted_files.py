"""A spec of somebody else makes no message quote a file that it has no business with."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.cli.exit_codes import ExitCode
from tests.cli.command_line import CommandLine

HIDDEN = "k3pt"
HEAD = "msnn: 1\nname: m\nsample_time: 0.1 s\ninputs: {u: {}}\n"
USES = {
    "spec": HEAD + "use: {part: {spec: FILE}}\noutputs: {y: u}\n",
    "weights": HEAD + "use: {part: {spec: part.yaml, weights: FILE}}\noutputs: {y: u}\n",
    "robot": HEAD + "use: {arm: {robot: {urdf: FILE}}}\noutputs: {y: u}\n",
    "numbers": HEAD + "parameters: {k: {init: {file: FILE}}}\noutputs: {y: u * k}\n",
    "data": HEAD + "outputs: {y: u}\ndata: {source: {all: FILE}}\n",
}
TEXTS = (
    f"TOKEN={HIDDEN}\n",
    f"{HIDDEN}: 1\n",
    f"1 {HIDDEN}\n",
    f"msnn: 1\nname: {HIDDEN}-\n",
    f"<a><{HIDDEN}></a>\n",
)


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The path of a spec in a folder of work; files beside that are of somebody else."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "part.yaml").write_text(HEAD + "outputs: {y: u}\n")
    monkeypatch.chdir(work)
    return work / "m.msnn.yaml"


@pytest.fixture
def msnn(spec: Path, capsys: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(spec.parent, capsys)


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("kind", ["spec", "weights", "robot", "numbers"])
@pytest.mark.parametrize("way", ["path", "link"])
def test_nothing_is_quoted_of_a_file_in_another_folder(
    kind: str, text: str, way: str, spec: Path, msnn: CommandLine
) -> None:
    foreign = spec.parent.parent / "foreign.txt"
    foreign.write_text(text)
    (spec.parent / "link.txt").symlink_to("../foreign.txt")
    named = {"path": "../foreign.txt", "link": "link.txt"}[way]
    spec.write_text(USES[kind].replace("FILE", named))
    for words in (("check", spec.name), ("check", spec.name, "--format", "json")):
        said = msnn(*words)
        assert said.code == ExitCode.DIAGNOSTICS
        assert HIDDEN not in said.out + said.err
        assert named.removeprefix("../") in said.out + said.err


def test_a_file_of_the_working_folder_is_quoted_as_ever(spec: Path, msnn: CommandLine) -> None:
    (spec.parent / "parts").mkdir()
    (spec.parent / "models").mkdir()
    (spec.parent / "parts" / "part.yaml").write_text("msnn: 1\nnam: part\n")
    (spec.parent / "models" / "m.yaml").write_text(
        USES["spec"].replace("FILE", "../parts/part.yaml")
    )
    assert "did you mean `name`?" in msnn("check", "models/m.yaml").err


def test_the_command_that_the_message_names_shows_the_mistake(
    spec: Path, msnn: CommandLine
) -> None:
    foreign = spec.parent.parent / "part.yaml"
    foreign.write_text("msnn: 1\nnam: part\n")
    spec.write_text(USES["spec"].replace("FILE", "../part.yaml"))
    said = msnn("check", spec.name)
    assert "error[E0730]" in said.err
    assert "`msnn check ../part.yaml` shows them" in said.err
    assert "did you mean `name`?" in msnn("check", "../part.yaml").err


@pytest.mark.parametrize("kind", USES)
@pytest.mark.parametrize("way", ["path", "link"])
def test_no_file_of_the_system_is_read(
    kind: str, way: str, spec: Path, msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the environment, in which CI keeps passwords, either."""
    system = Path("/proc/self/status")
    if not system.exists():
        pytest.skip("the system shows no files of itself")
    suffix = ".csv" if kind == "data" else ".txt"
    (spec.parent / f"link{suffix}").symlink_to(system)
    spec.write_text(USES[kind].replace("FILE", str(system) if way == "path" else f"link{suffix}"))
    said = msnn("check", spec.name, "--data")
    assert said.code == ExitCode.DIAGNOSTICS
    assert "made up by the system" in said.err or (kind, way) == ("data", "path"), said.err
    for line in ("Umask", "VmPeak", "SigQ"):
        assert line not in said.err

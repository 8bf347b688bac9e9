"""How far a simulation is: said to who waits, not more often than they can read."""

from __future__ import annotations

import io

import pytest

from msnn.cli.console import StepProgress
from tests.cli.command_line import CommandLine
from tests.conditions import require_tool


class Clock:
    """A time that the test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr("msnn.cli.console.time", found)
    return found


def test_short_ones_say_nothing(clock: Clock) -> None:
    stream = io.StringIO()
    with StepProgress(stream) as progress:
        for done in range(0, 1000, 100):
            clock.now += 0.05
            progress.told(done, 1000)
    assert stream.getvalue() == ""


def test_a_second_simulation_after_a_slow_first_step_says_nothing_of_no_steps(
    clock: Clock,
) -> None:
    """A machine under load ended `report` with a division by zero."""
    stream = io.StringIO()
    with StepProgress(stream) as progress:
        progress.told(10, 1000)
        clock.now += 2.0
        progress.told(10, 1000)
        progress.told(5, 1000)
        assert stream.getvalue() == ""
        progress.told(20, 1000)
    assert stream.getvalue() == "  20 of 1,000 steps, 196 s left\n"


def test_long_ones_say_how_far_they_are_every_five_seconds(clock: Clock) -> None:
    stream = io.StringIO()
    with StepProgress(stream) as progress:
        for done in range(0, 200_000, 1000):
            progress.told(done, 200_000)
            clock.now += 0.125
    lines = stream.getvalue().splitlines()
    assert lines[0] == "  8,000 of 200,000 steps, 24 s left"
    assert len(lines) == 5


def test_a_terminal_has_one_line_that_goes(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msnn.cli.console.is_live", lambda _: True)
    stream = io.StringIO()
    with StepProgress(stream) as progress:
        for done in (10, 20, 30):
            progress.told(done, 40)
            clock.now += 2.0
    assert "\n" not in stream.getvalue()
    assert "20 of 40 steps, 4 s left" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[2K")


@pytest.mark.parametrize("engine", ["native", "torch", "interpreter"])
def test_the_commands_take_an_engine(engine: str, msnn: CommandLine) -> None:
    require_tool("gcc", install="apt install gcc")
    assert msnn("init", "plant").code == 0
    spec = "plant/plant.msnn.yaml"
    said = msnn("validate", spec, "--initial", "--engine", engine, "--set", "validate=[]")
    assert said.code == 0, said.err
    assert "x_next  rmse" in said.out
    said = msnn("simulate", spec, "--initial", "--engine", engine, "--horizon", "20")
    assert said.code == 0, said.err


def test_the_commands_name_the_engines_that_there_are(msnn: CommandLine) -> None:
    assert msnn("init", "plant").code == 0
    said = msnn("validate", "plant/plant.msnn.yaml", "--initial", "--engine", "nativ")
    assert said.code == 1
    assert "error[E1043]: there is no engine `nativ`" in said.err
    assert "did you mean `native`?" in said.err
    assert "fmu, all" in said.err
    said = msnn("simulate", "plant/plant.msnn.yaml", "--initial", "--engine", "all")
    assert "fmu, all" not in said.err

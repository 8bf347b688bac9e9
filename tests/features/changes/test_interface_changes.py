"""What of an interface breaks those who use it, and what they never see."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.features.changes.interface_changes import export_changes, interface_changes
from msnn.features.changes.model_changes import error_growth
from msnn.model.load import load_model

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
dims: {wheel: [left, right]}
inputs:
  u: {unit: V, range: [-1, 1]}
  w: {unit: m, dims: [wheel]}
parameters: {k: {init: 2, unit: m/V, min: 0, max: 10}}
states: {s: {unit: m, next: s + k*u, init: 0}}
equations: {y: {expr: k*u + s + sum(w), unit: m, range: [-5, 5]}}
outputs:
  z: u[t-1]
export: {c: {outputs: [y]}}
"""


@pytest.mark.parametrize(
    ("old", "new", "said", "breaks"),
    [
        ("name: plant", "name: valve", ("model", "plant", "valve"), True),
        ("0.1 s\n", "0.2 s\n", ("sample time", "0.1 s", "0.2 s"), True),
        ("w: {unit: m,", "w: {unit: cm,", ("input w unit", "m", "cm"), True),
        ("range: [-1, 1]", "range: [-1, 2]", ("input u range", "-1 … 1", "-1 … 2"), False),
        ("range: [-1, 1]", "range: [0, 1]", ("input u range", "-1 … 1", "0 … 1"), True),
        ("range: [-5, 5]", "range: [-4, 5]", ("output y range", "-5 … 5", "-4 … 5"), False),
        ("range: [-5, 5]", "range: [-5, 6]", ("output y range", "-5 … 5", "-5 … 6"), True),
        ("max: 10", "max: 20", ("parameter k range", "0 … 10", "0 … 20"), False),
        ("max: 10", "max: 9", ("parameter k range", "0 … 10", "0 … 9"), True),
        ("  z: u[t-1]\n", "  z: u[t-9]\n", ("start from u samples", "t-1", "t-9 … t-1"), True),
        ("  z: u[t-1]\n", "  z: u[t-1]\n  q: u\n", ("output q", None, "V"), False),
        ("  z: u[t-1]\n", "  z: u[t]\n", ("start from u", "t-1", None), True),
        (
            "  z: u[t-1]\n",
            '  z: {expr: "u[t-1]", predicts: "u[t+1]"}\n',
            ("output z predicts", "", "u[t+1]"),
            True,
        ),
        ("[left, right]", "[left, right, spare]", ("input w shape", "wheel 2", "wheel 3"), True),
        (
            "[left, right]",
            "[right, left]",
            ("dimension wheel labels", "left, right", "right, left"),
            True,
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_one_change(
    old: str, new: str, said: tuple[str, str | None, str | None], breaks: bool
) -> None:
    assert SPEC.count(old) == 1
    (found,) = _changes(SPEC.replace(old, new))
    assert (f"{found.part} {found.what}".strip(), found.old, found.new) == said
    assert bool(found.breaks) is breaks


def test_dimensions_are_told_in_the_order_of_the_spec() -> None:
    names = ["wheel", "axle", "cell", "arm", "leg", "tank"]
    dims = ", ".join(f"{name}: [left, right]" for name in names)
    inputs = "".join(f"  in_{name}: {{dims: [{name}]}}\n" for name in names)
    spec = f"msnn: 1\nname: plant\nsample_time: 0.1 s\ndims: {{{dims}}}\ninputs:\n{inputs}"
    spec += f"outputs: {{y: {' + '.join(f'sum(in_{name})' for name in names)}}}\n"
    old, new = (
        load_model(Path("plant.msnn.yaml"), text=each).program
        for each in (spec, spec.replace("[left, right]", "[right, left]"))
    )
    found = interface_changes(old, new)
    assert [change.part for change in found] == [f"dimension {name}" for name in names]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("y: {expr: k*u", "y: {expr: 2*k*u"),
        ("init: 2", "init: 3"),
        ("plant", "plant\ndoc: d"),
    ],
)
def test_what_nobody_sees_is_no_change(old: str, new: str) -> None:
    assert _changes(SPEC.replace(old, new, 1)) == ()


def _changes(new: str):
    old, other = (load_model(Path("plant.yaml"), text=text).program for text in (SPEC, new))
    return interface_changes(old, other)


NAMED = "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {ρ: m}\noutputs: {y: ρ}\n"


def test_an_input_whose_identifier_another_takes_is_called_otherwise() -> None:
    both = NAMED.replace("{ρ: m}", "{rho: m, ρ: m}").replace("y: ρ", "y: rho + ρ")
    old, new = (load_model(Path("p.yaml"), text=text).program for text in (NAMED, both))
    found = {f"{each.part} {each.what}".strip(): each for each in interface_changes(old, new)}
    assert found.keys() == {"input rho", "input ρ name in exports"}
    assert found["input rho"].breaks, "who calls the step must give it"
    renamed = found["input ρ name in exports"]
    assert (renamed.old, renamed.new) == ("rho", "rho_2")
    assert renamed.breaks


def test_more_samples_of_an_input_and_of_a_start_must_be_given() -> None:
    ahead = _changes(SPEC.replace("{expr: k*u + s + sum(w)", '{expr: "k*u[t+1] + s + sum(w)"'))
    (samples,) = (each for each in ahead if each.what == "samples")
    assert (samples.part, samples.old, samples.new) == ("input u", "t", "t … t+1")
    assert samples.breaks
    before = SPEC.replace("  z: u[t-1]\n", "  z: u\n")
    old, new = (load_model(Path("p.yaml"), text=text).program for text in (before, SPEC))
    (start,) = interface_changes(old, new)
    assert (start.part, start.old, start.new) == ("start from u", None, "t-1")
    assert start.breaks


C = "export: {c: {outputs: [y]}}"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("c: {}", "c: {dtype: float64}", ("export c dtype", "float32", "float64")),
        ("c: {dtype: float32}", "c: {}", None),
        ("fmu: {}", "fmu: {dtype: float64}", ("export fmu dtype", "float32", "float64")),
        ("c: {prefix: valve}", "c: {prefix: tank}", ("export c prefix", "valve", "tank")),
        ("c: {}", "c: {prefix: tank}", ("export c prefix", "", "tank")),
        ("c: {}", "c: {params: tunable}", ("export c params", "const", "tunable")),
        ("c: {}", "c: {delay: u}", ("export c delay", "", "u")),
        ("c: {delay: [u, w]}", "c: {delay: [w, u]}", None),
        ("c: {close: [u]}", "c: {}", ("export c close", "u", "")),
        ("c: {}", "c: {unroll: 9, ring: double}", None),
        ("c: {}", "casadi: {}", None),
    ],
)
def test_a_change_of_what_an_export_promises(
    old: str, new: str, said: tuple[str, str, str] | None
) -> None:
    assert SPEC.count(C) == 1
    models = (
        load_model(Path("plant.yaml"), text=SPEC.replace(C, f"export: {{{each}}}"))
        for each in (old, new)
    )
    found = [(f"{each.part} {each.what}", each.old, each.new) for each in export_changes(*models)]
    assert found == ([] if said is None else [said])


def test_an_equation_that_an_export_leaves_out_takes_what_only_it_uses() -> None:
    found = {change.part: change for change in _changes(SPEC.replace("[y]", "[z]"))}
    for part in ("input w", "output y", "parameter k", "state s"):
        assert found[part].new is None
        assert found[part].breaks


@pytest.mark.parametrize(
    ("metric", "old", "new", "growth"),
    [
        ("rmse", 2.0, 3.0, 0.5),
        ("rmse", 0.0, 1e-9, float("inf")),
        ("rmse", 0.0, 0.0, 0.0),
        ("rmse", 1.0, float("nan"), float("inf")),
        ("rmse", float("nan"), 1.0, -1.0),
        ("rmse", float("inf"), 1.0, -1.0),
        ("rmse", float("nan"), float("nan"), 0.0),
        ("rmse", float("inf"), float("nan"), 0.0),
        ("rmse", 1.0, float("inf"), float("inf")),
        ("fit", 50.0, float("nan"), float("inf")),
        ("fit", float("-inf"), 50.0, -1.0),
        ("fit", 90.0, 95.0, -0.5),
        ("fit", 99.0, 98.0, 1.0),
        ("r2", 0.75, 0.5, 1.0),
        ("aic", -100.0, 100.0, None),
        ("loss", -4.0, -3.0, 0.25),
    ],
)
def test_growth_of_the_error_behind_a_metric(
    metric: str, old: float, new: float, growth: float | None
) -> None:
    assert error_growth(metric, old, new) == growth

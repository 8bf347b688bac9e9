"""A layer of a plug-in has a window as ours do, and a wrong type of the field is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.api.measurements import simulate
from msnn.api.models import load
from msnn.cli.application import run
from spec_schema.diagnostics.diagnostic import SpecError
from tests.extending.conftest import Install
from tests.extending.test_plugins import spec_file

MEAN = """
from msnn.extending import *

class Mean(Entry):
    noun = "a mean layer"
    window: {field} | None = None

def expand(context, settings, arguments):
    (x,) = arguments
    builder = context.builder
    axis = builder.type(x).axes[-1]
    return builder.divide(builder.sum(x, axis.name), builder.constant(float(axis.size)))

MEAN = LayerRule(Mean, {read}, expand)
FEATURE = Feature(name="means", layers=(
    LayerLine("mean", LateEntry("means", "Mean"), LateObject("means", "MEAN"), "A mean."),
))
"""
SPEC = (
    "msnn: 1\nname: m\nsample_time: 10 ms\ninputs: {u: {}}\nlayers: {m: {mean: SETTINGS}}\n"
    "outputs: {y: CALL}\n"
)


def spec(folder: Path, settings: str, call: str = "m(u)") -> Path:
    return spec_file(folder, SPEC.replace("SETTINGS", settings).replace("CALL", f"'{call}'"))


def put(install: Install, field: str = "PositiveLength", read: str = "read_window") -> None:
    install("means", {"means.py": MEAN.format(field=field, read=read)}, "means:FEATURE")


@pytest.mark.parametrize(
    ("settings", "call"),
    [
        ("{window: 3}", "m(u)"),
        ("{window: 30 ms}", "m(u)"),
        ("{window: 0.03 s}", "m(u)"),
        ("{}", "m(u[t-2:t])"),
        ("{window: 30 ms}", "m(u[t-2:t])"),
    ],
)
def test_a_window_is_a_number_of_samples_or_a_duration(
    settings: str, call: str, install: Install, tmp_path: Path
):
    put(install)
    (found,) = simulate(load(spec(tmp_path, settings, call)), {"u": [3.0, 6.0, 9.0, 0.0]})
    np.testing.assert_allclose(found.outputs["y"][-2:], [6.0, 5.0])


@pytest.mark.parametrize(
    ("settings", "call", "message"),
    [
        ("{window: 0}", "m(u)", "out of range"),
        ("{window: 3 m}", "m(u)", "`3 m`"),
        ("{window: 35 ms}", "m(u)", "not a multiple"),
        ("{}", "m(u)", "window"),
        ("{window: 20 ms}", "m(u[t-2:t])", "2 samples"),
    ],
)
def test_a_wrong_window_is_reported_as_ours(
    settings: str, call: str, message: str, install: Install, tmp_path: Path
):
    put(install)
    with pytest.raises(SpecError, match=message) as caught:
        load(spec(tmp_path, settings, call))
    assert caught.value.diagnostics[0].code != "E0230"


@pytest.mark.parametrize("read", ["read_window", "lambda c, s: c.sampling.samples(s.window)"])
@pytest.mark.parametrize(
    ("field", "kind"), [("PositiveCount", "int"), ("Text", "str"), ("QuantityField", "Quantity")]
)
def test_another_type_of_the_window_is_a_mistake_of_the_plugin(
    field: str,
    kind: str,
    read: str,
    install: Install,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    put(install, field, read)
    window = "30 ms" if field == "QuantityField" else "3"
    assert run(["check", str(spec(tmp_path, f"{{window: {window}}}"))]) == 1
    said = capsys.readouterr().err
    assert "error[E0230]: the layer `mean` of the package means 0.1.0 raised TypeError" in said
    assert f"a {kind} is no length: declare the field of the settings as" in said
    assert "`msnn.extending.PositiveLength`" in said

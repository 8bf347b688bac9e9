"""Numbers with units that reach something without a unit: times other than the second, prefixes."""

import pytest

from tests.language.compiled import codes, warnings_of


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("L/h", "3600 s/h"),
        ("m^3/d", "86400 s/d"),
        ("1/min", "60 s/min"),
        ("rpm", "60 s/min"),
        ("kph", "3600 s/h"),
        ("km/h", "3600 s/h"),
        ("mm/ms", "0.001 s/ms"),
        ("kHz", "0.001 s*kHz"),
        ("kWh/d", "86400 s/d"),
    ],
)
def test_a_state_without_unit_tells_of_a_rate_per_another_time(unit: str, factor: str) -> None:
    spec = f"inputs: {{F: {unit}}}\nstates: {{v: {{der: F}}}}\noutputs: {{y: v}}\n"
    assert "W0509" in warnings_of(spec)
    # the advice
    repaired = f"""
    inputs: {{F: {unit}}}
    constants: {{time: {factor}}}
    states: {{v: {{der: F / time}}}}
    outputs: {{y: v}}
    """
    assert warnings_of(repaired) == []


@pytest.mark.parametrize(
    "unit", ["L/s", "m/s", "W", "kW", "A", "rad/s", "rps", "Hz", "km/h/s", "rpm/s", "1", "m", "mA"]
)
def test_a_rate_per_second_is_silent(unit: str) -> None:
    spec = f"inputs: {{F: {unit}}}\nstates: {{v: {{der: F}}}}\noutputs: {{y: v}}\n"
    assert warnings_of(spec) == []


@pytest.mark.parametrize(
    "integrator",
    [
        "euler",
        "semi_implicit",
        "linear_implicit",
        "{linear_implicit: {of: loss}}",
        "midpoint",
        "rk4",
    ],
)
def test_every_integrator_tells_of_it_once(integrator: str) -> None:
    spec = f"""
    integrator: {integrator}
    inputs: {{F: L/h}}
    equations: {{loss: 0.1*v}}
    states: {{v: {{der: F - loss}}, w: {{der: F, unit: L}}}}
    outputs: {{y: v + w/L}}
    constants: {{L: 1 L}}
    """
    found = warnings_of(spec)
    assert found.count("W0509") == 1
    # a state with a unit is the unit check's
    assert "W0504" in found


LAW = """
inputs: {u: {}, w: V}
parameters: {L: ENTRY}
states: {i: {der: LAW}}
outputs: {y: i}
"""


@pytest.mark.parametrize("entry", ["300 uH", "{init: 300 uH}", "{init: 300 uH, learn: false}"])
@pytest.mark.parametrize("law", ["u / L", "w / L", "u - i*L", "2*w / L + u"])
def test_a_parameter_in_a_multiple_meets_a_value_without_unit(entry: str, law: str) -> None:
    assert warnings_of(LAW.replace("ENTRY", entry).replace("LAW", law)).count("W0510") == 1


def test_decibels_are_no_ratio() -> None:
    spec = LAW.replace("ENTRY", "6 dB").replace("LAW", "u * L + 0*w")
    assert warnings_of(spec) == ["W0510"]
    assert warnings_of(spec.replace("6 dB", "{init: 6 dB, unit: 1}")) == []


def test_a_constant_does_too() -> None:
    spec = LAW.replace("parameters", "constants").replace("ENTRY", "300 uH")
    assert warnings_of(spec.replace("LAW", "(u + 0*w) / L")) == ["W0510"]


@pytest.mark.parametrize(
    "entry",
    [
        "{init: 300 uH, unit: H}",
        "{init: 300, unit: uH}",
        "{unit: uH, init: 300}",
        "3e-4 H",
        "3e-4",
        "5 kg",
    ],
)
def test_a_declared_unit_or_an_si_unit_is_silent(entry: str) -> None:
    assert warnings_of(LAW.replace("ENTRY", entry).replace("LAW", "(u + 0*w) / L")) == []


def test_where_all_units_are_known_the_unit_check_has_the_word() -> None:
    spec = """
    inputs: {level: m}
    constants: {cm: 1 cm}
    outputs: {y: {expr: level / cm, unit: m/cm}}
    """
    assert warnings_of(spec) == []


def test_a_sum_with_a_declared_unit_says_that_the_scale_is_meant() -> None:
    spec = """
    inputs: {level: cm}
    constants: {least: 0.1 cm}
    parameters: {k: 2}
    outputs: {y: "k * sqrt(max(level, least))"}
    """
    assert warnings_of(spec) == []
    assert warnings_of(spec.replace("max(level, least)", "max(0, least) * level")) == ["W0510"]


def test_weights_of_a_layer_take_any_scale() -> None:
    spec = """
    inputs: {u: m}
    constants: {mm: 1 mm}
    layers: {f: {fir: {}}}
    outputs: {y: "f(u.past(3) * mm)"}
    """
    assert "W0510" not in warnings_of(spec)


PLACES = {
    "min": "parameters: {k: {init: 1, min: 0.5 mH}}\noutputs: {y: k*u}",
    "max": "parameters: {k: {init: 1, max: 3 kohm}}\noutputs: {y: k*u}",
    "prior": "parameters: {k: {init: 1, prior: {mean: 2 mm, std: 1}}}\noutputs: {y: k*u}",
    "std of a prior": "parameters: {k: {init: 1, prior: {mean: 2, std: 1 mm}}}\noutputs: {y: k*u}",
    "range of an input": "targets: {z: {range: [0, 5 mV]}}\noutputs: {y: {expr: u, predicts: z}}",
    "range of a state": "states: {x: {next: u, range: [0, 5 mV]}}\noutputs: {y: x}",
    "range of an equation": "equations: {e: {expr: 2*u, range: [0, 5 mV]}}\noutputs: {y: e}",
    "degrees": "states: {x: {next: u, range: [0, 90 deg]}}\noutputs: {y: x}",
    "temperatures": "states: {x: {next: u, range: [0, 20 degC]}}\noutputs: {y: x}",
    "start of a state": "constants: {c: 3 mm}\nstates: {x: {next: x, init: c}}\noutputs: {y: x+u}",
    "bound of a control": (
        "states: {x: {next: 0.9*x + u, init: 0}}\noutputs: {y: x}\n"
        "mpc: {horizon: 5, controls: [u], cost: x**2 + u**2, bounds: {u: {max: 5 mV}}}"
    ),
    "rate of a control": (
        "states: {x: {next: 0.9*x + u, init: 0}}\noutputs: {y: x}\n"
        "mpc: {horizon: 5, controls: [u], cost: x**2 + u**2, bounds: {u: {rate: 5 mV/s}}}"
    ),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_quantity_in_a_multiple_of_what_has_no_unit(place: str) -> None:
    spec = f"inputs: {{u: {{}}}}\n{PLACES[place]}\n"
    assert codes(spec) == []
    assert "W0510" in warnings_of(spec)


@pytest.mark.parametrize("place", PLACES)
def test_an_si_unit_has_the_same_number(place: str) -> None:
    plain = PLACES[place]
    for scaled, si in (("mH", "H"), ("kohm", "ohm"), ("mm", "m"), ("mV", "V")):
        plain = plain.replace(scaled, si)
    plain = plain.replace("90 deg", "1.5 rad").replace("20 degC", "293 K")
    assert "W0510" not in warnings_of(f"inputs: {{u: {{}}}}\n{plain}\n")


@pytest.mark.parametrize("integrator", ["euler", "rk4", "midpoint", "semi_implicit"])
@pytest.mark.parametrize("rate", ["0", "-0", "0 * u", "0.0 + 0", "0 - 0", "0 * 3"])
@pytest.mark.parametrize("unit", ["m", "degC", "1", "rad/s"])
def test_a_rate_of_zero_has_every_unit(integrator: str, rate: str, unit: str) -> None:
    spec = f"""
    integrator: {integrator}
    inputs: {{u: V}}
    states: {{x: {{der: "{rate}", init: 1, unit: {unit}}}}}
    outputs: {{y: "x + 0 * u"}}
    """
    assert warnings_of(spec) == []


@pytest.mark.parametrize("rate", ["0", "0 * q", "0 * q * u"])
def test_a_rate_of_zeros_has_every_unit(rate: str) -> None:
    spec = f"""
    dims: {{n: 2}}
    inputs: {{u: V}}
    states: {{q: {{der: "{rate}", dims: n, unit: m}}}}
    outputs: {{y: q * u}}
    """
    assert warnings_of(spec) == []


def test_a_rate_that_is_not_zero_needs_its_unit() -> None:
    spec = "inputs: {u: V}\nstates: {x: {der: 0 * u + 1, unit: m}}\noutputs: {y: x}\n"
    assert "W0504" in warnings_of(spec)

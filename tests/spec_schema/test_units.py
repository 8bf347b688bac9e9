"""Units mean what pint says they mean."""

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msnn.data.formats.written_units import CapitalUnit, keeps_case, written_unit
from msnn.data.reading.columns import converted_cells
from spec_schema.units.parser import collisions, parse_unit
from spec_schema.units.quantity import turn_readings
from spec_schema.units.unit import ONE, PREFIXES, UNIT_ROWS, Unit, UnitError, unit_symbol

# What pint calls the symbols that it spells otherwise.
_PINT_NAMES = {
    "Ω": "ohm",
    "%": "percent",
    "deg": "degree",
    "gon": "grade",
    "arcmin": "arcminute",
    "arcsec": "arcsecond",
    "rps": "revolution/second",
    "rev": "revolution",
    "kgf": "kilogram_force",
    "lbf": "pound_force",
    "kn": "knot",
    "PS": "metric_horsepower",
    "g0": "standard_gravity",
    "gal": "gallon",
    "St": "stokes",
    "P": "poise",
    "t": "tonne",
    "T": "tesla",
    "Btu": "Btu_it",
    "hp": "UK_horsepower",
    "au": "astronomical_unit",
    "Ah": "ampere_hour",
    "Wh": "watt_hour",
    "degC": "delta_degC",
    "degF": "delta_degF",
    "in": "inch",
    "min": "minute",
    "L": "liter",
    "l": "liter",
    "C": "coulomb",
    "F": "farad",
    "H": "henry",
    "h": "hour",
    "d": "day",
    "nmi": "nautical_mile",
    "mmHg": "mmHg",
    "kph": "kph",
}
_BASES = ("meter", "kilogram", "second", "ampere", "kelvin", "mole", "candela")
# Products of a few rounded factors.
_CLOSE = 1e-12


@pytest.fixture(scope="module")
def registry() -> Any:
    return pint.UnitRegistry()


@pytest.mark.parametrize("symbol", [symbol for symbol in UNIT_ROWS if symbol != "dB"])
def test_symbol_is_what_pint_says(symbol: str, registry: Any) -> None:
    unit = unit_symbol(symbol)
    assert unit is not None
    oracle = registry.Quantity(1, _PINT_NAMES.get(symbol, symbol)).to_base_units()
    # rpm and rps: pint measures angle in radians of dimension 1, as do checks here.
    assert oracle.magnitude == pytest.approx(unit.scale, rel=_CLOSE)
    powers = dict.fromkeys(_BASES, 0)
    powers.update({b: p for b, p in oracle._units.items() if b != "radian"})
    assert [powers[base] for base in _BASES] == [float(e) for e in unit.exponents[:7]]


@pytest.mark.parametrize("prefix", PREFIXES)
def test_prefix_is_what_pint_says(prefix: str, registry: Any) -> None:
    unit = unit_symbol(f"{prefix}N")
    assert unit is not None
    oracle = registry.Quantity(1, f"{prefix}N").to_base_units().magnitude
    assert oracle == pytest.approx(unit.scale, rel=_CLOSE)


def test_no_prefixed_unit_hides_a_unit_of_its_own() -> None:
    for prefix in PREFIXES:
        for symbol, row in UNIT_ROWS.items():
            unit = unit_symbol(prefix + symbol) if row.prefixes else None
            if unit is not None and prefix + symbol in UNIT_ROWS:
                # `min`, `cd`, `Pa` … : the plain meaning wins.
                own = UNIT_ROWS[prefix + symbol]
                assert unit.scale == own.scale


@pytest.mark.parametrize(
    ("value", "unit", "target", "expected"),
    [
        (20.0, "degC", "K", 293.15),
        (-40.0, "degF", "degC", -40.0),
        (100.0, "km/h", "m/s", 100 / 3.6),
        (180.0, "deg", "rad", math.pi),
        (60.0, "rpm", "rad/s", 2 * math.pi),
        (50.0, "%", "1", 0.5),
        (1.0, "kWh", "J", 3.6e6),
        (1.0, "Hz", "1/s", 1.0),
    ],
)
def test_conversion(value: float, unit: str, target: str, expected: float) -> None:
    found = parse_unit(unit).convert(value, parse_unit(target))
    # degF has a rounded offset of 255 K; the others are one product.
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "unit", "target", "expected"),
    [
        (20.0, "dB", "1", 10.0),
        (-6.0, "dB", "1", 10**-0.3),
        (20.0, "dB", "%", 1000.0),
        (10.0, "1", "dB", 20.0),
        (50.0, "%", "dB", 20 * math.log10(0.5)),
        (0.0, "1", "dB", -math.inf),
        (3.0, "dB", "dB", 3.0),
    ],
)
def test_decibels_are_of_ratios(value: float, unit: str, target: str, expected: float) -> None:
    found = parse_unit(unit).convert(value, parse_unit(target))
    # a power, a logarithm and a product, each rounded once
    assert found == pytest.approx(expected, rel=1e-14)
    cells = converted_cells(np.array([value]), parse_unit(unit).line_to(parse_unit(target)))
    assert cells[0] == pytest.approx(expected, rel=1e-14)


def test_decibels_are_no_numbers_in_formulas() -> None:
    level = parse_unit("dB")
    assert not level.same_dimension(ONE)
    assert not level.converts_to(parse_unit("V"))
    assert not parse_unit("dB/s").converts_to(parse_unit("1/s"))
    assert (parse_unit("dB/K") * parse_unit("K")).same_as(level)
    with pytest.raises(ValueError, match="does not convert"):
        level.convert(3.0, ONE, is_distance=True)


@pytest.mark.parametrize("text", ["1", "3", "7", "10", "33", "50", "100", "250", "700"])
@pytest.mark.parametrize(("unit", "exponent"), [("us", -6), ("ms", -3)])
def test_short_times_are_the_nearest_number(text: str, unit: str, exponent: int) -> None:
    """10 us was 9.999999999999999e-06 s."""
    nearest = float(Decimal(text).scaleb(exponent))
    assert parse_unit(unit).in_si(float(text)) == nearest
    assert parse_unit(unit).convert(float(text), parse_unit("s")) == nearest
    assert parse_unit(unit).convert(float(text), parse_unit("s"), is_distance=True) == nearest


@pytest.mark.parametrize(("unit", "same"), [("psi", "lbf/in^2"), ("L", "dm^3"), ("J", "N*m")])
def test_numbers_stay_as_they_are_in_the_same_unit_by_another_name(unit: str, same: str) -> None:
    """The scales of the first two differ by a rounding, which no number may show."""
    one, other = parse_unit(unit), parse_unit(same)
    for value in (0.1, 3.0, 33.3, 1000.0):
        assert one.convert(value, other) == other.convert(value, one) == value


def test_incomparable_units_do_not_convert() -> None:
    with pytest.raises(ValueError, match="m does not convert to s"):
        parse_unit("m").convert(1.0, parse_unit("s"))


def test_offset_is_lost_in_products() -> None:
    assert parse_unit("J/degC").same_as(parse_unit("J/K"))
    assert not parse_unit("degC").same_as(parse_unit("K"))


@pytest.mark.parametrize("unit", ["degC^2", "degC^-1", "degC^2*s/s", "1/degC"])
def test_offset_is_lost_in_powers(unit: str) -> None:
    """A variance of 4 degC² is one of 4 K²: nothing is added to it."""
    other = parse_unit(unit.replace("degC", "K"))
    assert parse_unit(unit).same_as(other)
    assert parse_unit(unit).in_si(4.0) == parse_unit(unit).convert(4.0, other) == 4.0


def test_offset_is_lost_in_roots() -> None:
    assert parse_unit("degC").power(2).root(2).same_as(parse_unit("K"))
    assert parse_unit("degF^2").convert(81.0, parse_unit("K^2")) == pytest.approx(25.0, rel=1e-14)


def test_angle_is_tagged_and_counts_as_one() -> None:
    assert parse_unit("rad").same_as(ONE)
    assert parse_unit("rad") != ONE
    assert parse_unit("deg").same_dimension(ONE)
    assert not parse_unit("deg").same_as(ONE)
    assert parse_unit("rad/s").same_as(parse_unit("Hz"))


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("m/s^2", "m/s^2"),
        ("N * m", "N*m"),
        ("1/m/rad", "1/m/rad"),
        ("m*m", "m^2"),
        ("m/m", "1"),
        ("s^-1", "1/s"),
        ("m**2", "m^2"),
        ("µm", "μm"),
        ("kg·m", "kg*m"),
        ("1", "1"),
    ],
)
def test_canonical_text(text: str, canonical: str) -> None:
    assert parse_unit(text).text == canonical


@pytest.mark.parametrize(
    ("text", "start", "end", "repair"),
    [
        ("Nm", 0, 2, "N*m"),
        ("m/sec", 2, 5, "s"),
        ("°C", 0, 2, "degC"),
        ("m s", 2, 3, None),
        ("J/(kg*K)", 2, 8, "kg/K"),
        # divided by a quotient: N/m/s would be another unit
        ("N/(m/s)", 2, 7, "m*s"),
        ("N*(m/s)", 2, 7, "m/s"),
        ("1/(m**2*s/kg)", 2, 13, "m**2/s*kg"),
        ("W/(m*K)^2", 2, 3, "J/kg/K"),
        ("m(s)", 1, 2, "J/kg/K"),
        ("J/((kg)*K)", 2, 3, "J/kg/K"),
        ("m/", 1, 2, None),
        ("*m", 0, 1, None),
        ("m^0.5", 3, 4, None),
        ("2*m", 0, 1, None),
        ("m^999", 1, 5, None),
        ("", 0, 0, None),
    ],
)
def test_bad_text(text: str, start: int, end: int, repair: str | None) -> None:
    with pytest.raises(UnitError) as caught:
        parse_unit(text)
    assert (caught.value.start, caught.value.end, caught.value.repair) == (start, end, repair)


@pytest.mark.parametrize(
    ("written", "meant", "guess"),
    [
        # without doubt: columns of such a unit are converted
        ("khz", "kHz", "kHz"),
        ("KHz", "kHz", "kHz"),
        ("kpa", "kPa", "kPa"),
        ("Mpa", "MPa", "MPa"),
        ("Mhz", "MHz", "MHz"),
        ("Mw", "MW", "MW"),
        ("Ghz", "GHz", "GHz"),
        ("Kg", "kg", "kg"),
        ("kgs", "kg", "kg"),
        ("mins", "min", "min"),
        ("mps", "m/s", "m/s"),
        ("Pas", "Pa*s", "Pa*s"),
        ("Ns", "N*s", "N*s"),
        ("PSI", "psi", "psi"),
        # a guess for people alone: mega or milli, a force or a mass, an angle or its rate
        ("mpa", None, "mPa"),
        ("mhz", None, "mHz"),
        ("Mv", None, "MV"),
        ("Ma", None, "MA"),
        ("lbs", None, "lb"),
        ("rads", None, "rad"),
        ("kgg", None, "kg"),
        ("ss", None, "s"),
        # a word in brackets, as of a column `u (cmd)`, and centimetres by days
        ("cmd", None, "cm*d"),
        ("Foo", None, None),
    ],
)
def test_a_doubtful_symbol_is_no_unit_of_a_file(
    written: str, meant: str | None, guess: str | None
) -> None:
    with pytest.raises(UnitError) as caught:
        parse_unit(written)
    assert (caught.value.meant, caught.value.replacement) == (meant, guess)
    found = written_unit(written)
    assert (found and found.text) == meant


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Grad", [(0, "Grad", "1e+09 rad", "deg")]),
        ("Mm/Ms", [(0, "Mm", "1e+06 m", "mm"), (3, "Ms", "1e+06 s", "ms")]),
        ("kg*cV^2", [(3, "cV", "0.01 V", "PS")]),
        # correct units in which somebody measures, and parts of longer ones
        ("Mg/dt", []),
        ("km/h", []),
        ("MN/m", []),
        ("kt", []),
        ("mmol/dA", [(5, "dA", "0.1 A", "A")]),
    ],
)
def test_units_of_specs_that_mean_others_are_found(
    text: str, found: list[tuple[int, str, str, str]]
) -> None:
    assert collisions(text) == found


def test_no_symbol_is_two_units() -> None:
    prefixed = [prefix + row for prefix in PREFIXES for row, of in UNIT_ROWS.items() if of.prefixes]
    twice = {text for text in prefixed if text in UNIT_ROWS or prefixed.count(text) > 1}
    assert twice == {"ft"}  # nobody measures in femtotonnes
    assert parse_unit("ft").same_dimension(parse_unit("m"))


@pytest.mark.parametrize(
    ("written", "readings", "guess"),
    [
        ("MPA", ["mPa", "MPa"], "MPa"),
        ("MHZ", ["mHz", "MHz"], "MHz"),
        ("MV", ["MV", "mV"], None),
        ("MS", ["MS", "ms", "mS"], None),
        ("KN", ["kn", "kN"], "kN"),
        ("G", ["g"], "g"),
        ("M/S^2", ["m/S^2", "m/s^2"], "m"),
        ("ML/MIN", ["ML/min", "mL/min", "ml/min", "Ml/min"], "min"),
        ("NM", ["nm", "N*m", "nmi"], "N*m"),
        ("J/NM", ["J/nm", "J/N/m", "J/nmi"], "N/m"),
        # nobody measures in millions of these
        ("MM", ["mm"], "mm"),
        ("MBAR", ["mbar"], "mbar"),
        ("MRAD/S", ["mrad/S", "mrad/s"], "mrad"),
        ("MAH", ["mAh"], "mAh"),
        ("KPA", ["kPa"], "kPa"),
        ("DEG C", ["degC"], "deg"),
        ("U/MIN", ["rev/min"], None),
        ("M·S⁻¹", ["m/S", "m/s"], None),
        ("LBS", [], "lb"),
        # a prefix P may be peta, which no unit here has
        ("PHZ", [], "pHz"),
        ("PF", [], "pF"),
        ("SETPOINT", [], None),
    ],
)
def test_units_in_capitals_have_all_readings(
    written: str, readings: list[str], guess: str | None
) -> None:
    found = written_unit(written)
    units = found.readings if isinstance(found, CapitalUnit) else [found] if found else []
    assert [unit.text for unit in units] == readings
    if guess is not None:
        with pytest.raises(UnitError) as caught:
            parse_unit(written)
        assert caught.value.replacement == guess


@pytest.mark.parametrize(
    ("units", "names", "keeps"),
    [
        (["MV", "°C"], ["U", "T"], False),
        (["MV", "km/h"], ["U", "V"], True),
        (["MV", "KM/H"], ["speed"], False),
        (["MV", "MM"], ["Voltage", "Position"], False),
        # both: nobody knows
        (["MV", "MM", "km/h"], ["Voltage"], False),
        # names are enough for what is often counted in millions
        (["MW", "V"], ["Power"], True),
        (["MW", "V"], ["P"], False),
        (["MV", "V"], ["Voltage"], False),
        (["MA", "V"], ["Current"], False),
    ],
)
def test_units_show_whether_a_file_has_small_letters(
    units: list[str], names: list[str], keeps: bool
) -> None:
    assert keeps_case(units[0], units, names) is keeps


@pytest.mark.parametrize(
    ("written", "unit"),
    [
        # revolutions in English, German and French
        *((text, "rpm") for text in ("U/min", "Upm", "UPM", "r/min", "RPM", "revs/min", "tr/min")),
        *((text, "rev/s") for text in ("U/s", "r / s", "rev/s", "turns/s")),
        ("min-1", "1/min"),
        ("min⁻¹", "1/min"),
        ("m·s⁻²", "m/s^2"),
        ("kg·m²·s⁻²", "J"),
        ("microseconds", "us"),
        ("knots", "kn"),
        ("deg C", "degC"),
        ("Degrees Fahrenheit", "degF"),
        ("J/(kg K)", "J/kg/K"),
        ("rad/Nm", "rad/N/m"),
        ("1/kmh", "h/km"),
        ("kmph", "km/h"),
    ],
)
def test_spellings_of_files(written: str, unit: str) -> None:
    found = written_unit(written)
    assert isinstance(found, Unit)
    assert found.same_as(parse_unit(unit))
    assert found.angle == parse_unit(unit).angle


@pytest.mark.parametrize("written", ["U", "r", "tr", "U/m", "r/h", "U*min", "1-2", "m-"])
def test_a_letter_of_revolutions_is_none_alone(written: str) -> None:
    assert written_unit(written) is None


@pytest.mark.parametrize(
    ("unit", "other", "readings"),
    [
        ("1/min", "rpm", ("1/min", "rev/min", "rad/min")),
        ("rpm", "1/min", ("1/min", "rev/min", "rad/min")),
        ("Hz", "deg/s", ("Hz", "rev/s", "rad/s")),
        ("kHz", "rpm", ("kHz", "rev*kHz", "rad*kHz")),
        ("1/s^2", "rad/s^2", ("1/s^2", "rev/s^2", "rad/s^2")),
        ("1", "rev", ("1", "rev", "rad")),
        ("cm^3", "L/rev", ("cm^3", "cm^3/rev", "cm^3/rad")),
        ("V/Hz", "V*s/rad", ("V/Hz", "V*s/rev", "V*s/rad")),
        # the radian counts as 1 in all of these
        ("N*m", "N*m/rad", None),
        ("V*s", "V*s/rad", None),
        ("1", "rad", None),
        ("1", "deg", None),
        ("lm", "cd", None),
        # turns on both sides, or on none
        ("rpm", "rad/s", None),
        ("1/min", "Hz", None),
    ],
)
def test_readings_of_turns(unit: str, other: str, readings: tuple[str, str, str] | None) -> None:
    found = turn_readings(parse_unit(unit), parse_unit(other))
    assert (None if found is None else found.texts) == readings
    for reading in () if readings is None else readings:
        angled = max((parse_unit(unit), parse_unit(other)), key=lambda one: abs(one.angle))
        assert parse_unit(reading).same_dimension(angled)


_UNITS = st.lists(
    st.tuples(st.sampled_from(sorted(UNIT_ROWS)), st.integers(-3, 3).filter(bool)),
    min_size=1,
    max_size=4,
)


def test_absurd_powers_stay_within_floats() -> None:
    for text in ("eV^24", "1/eV^24", "eV^-24/eV^24/eV^24", "au^24*au^24"):
        unit = parse_unit(text).power(24)
        assert 0 < unit.scale < math.inf
        assert 0 < (ONE / unit).scale < math.inf


@settings(max_examples=200, deadline=None)
@given(_UNITS)
def test_text_reads_back_and_algebra_agrees(factors: list[tuple[str, int]]) -> None:
    product = ONE
    for symbol, power in factors:
        unit = unit_symbol(symbol)
        assert unit is not None
        product = product * unit.power(power)
    again = parse_unit(product.text)
    assert again.exponents == product.exponents
    if 1e-290 < product.scale < 1e290:
        # Beyond that the order of factors decides where the scale meets its bound.
        assert again.scale == pytest.approx(product.scale, rel=_CLOSE)
    assert (product / product).same_as(ONE)
    assert product.power(Fraction(2)).root(2).exponents == product.exponents


@settings(max_examples=300, deadline=None)
@given(st.text("mskgNrad*/^-1230 (). °Ω%", max_size=20) | st.text(max_size=10))
def test_any_text_is_a_unit_or_a_unit_error(text: str) -> None:
    error = _failure(text)
    assert error is None or 0 <= error.start <= error.end <= len(text)


def _failure(text: str) -> UnitError | None:
    try:
        parse_unit(text)
    except UnitError as error:
        return error
    return None


@pytest.mark.parametrize(
    ("written", "target", "value", "distance"),
    [("degC", "K", 283.15, 10.0), ("K", "degC", -263.15, 10.0), ("km", "m", 1e4, 1e4)],
)
def test_offsets_have_no_part_in_distances(
    written: str, target: str, value: float, distance: float
) -> None:
    own, other = parse_unit(written), parse_unit(target)
    assert own.convert(10.0, other) == pytest.approx(value, rel=1e-12)
    assert own.convert(10.0, other, is_distance=True) == distance


@pytest.mark.parametrize(
    ("text", "example", "scale"),
    [
        ("krpm", "rpm", 1000.0),
        ("KRPM", "rpm", 1000.0),
        ("V/krpm", "rpm", 1e-3),
        ("mdeg", "deg", 1e-3),
    ],
)
def test_a_unit_without_prefixes_is_named_with_its_factor(
    text: str, example: str, scale: float
) -> None:
    with pytest.raises(UnitError) as caught:
        parse_unit(text)
    assert (caught.value.repair, caught.value.scale) == (example, scale)
    # no editor puts it there: the number would change
    assert caught.value.replacement is None
    assert f"`{example}` takes no prefix: 1 " in str(caught.value)

"""Where one rule alone makes the error of a step, that error is what is proved of it.

Beside the rule nothing rounds: a bound that leaves the rule out is exceeded, a loose one is seen.
"""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.compile.tables import fitted_table
from msnn.features.fixed_point.deviation import ExactStepper
from msnn.features.fixed_point.integers.builder import CannotFitError, IntegerBuilder
from msnn.features.fixed_point.integers.interpret import initial, step
from msnn.features.fixed_point.integers.program import (
    Q15,
    Q31,
    IntegerLookup,
    Literal,
    RoundShift,
    Width,
)
from tests.features.fixed_point.exported import fixed_model, initial_weights, planned

STATE = """\
msnn: 1
name: rule
sample_time: 10 ms
inputs:
  u: {range: [-1, 1]}
  w: {range: [-1, 1]}
  fine: {range: [-0.015625, 0.015625]}
  near: {range: [-0.100002288818359375, 0.100002288818359375]}
  flat: {range: [12, 13]}
layers:
  sets: {fuzzify: {centers: [-0.3, 0.19999]}}
  narrow: {fuzzify: {centers: [-0.125, 0.125]}}
  beside: {fuzzify: {centers: [0.100001, 0.12499871118164062]}}
states: {x: {next: "FORMULA", range: [-1, 1], init: 0}}
outputs: {y: x}
"""
# 0.1 has the coefficient 26214 / 2^18: such a product is up to 1.53e-6 nearer to 0 than it should
SHORT = 0.1 - 26214 / 2**18
# 0.3 has the word 19661 / 2^16
LONG = 19661 / 2**16 - 0.3

# integers decide these: NUMBER is a number that 0.1·u passes, DECIDED and LIMITED are `near`
NUMBER = "max(0.1 * u, 0.099999)"
UNSURE = "where(0.1 * u >= 0.0999995, 0.9, 0.1)"
DECIDED = "min(near, 0.2000015 - 0.1 * w)"
LIMITED = f"min(near, 0.2000015 - {NUMBER})"
# at the ends of `u` and `fine` above 0 in real numbers, and below in integers
DOUBTED = "0.1 * u - 6.25 * fine - 0.0023425 > 0"
PASSED = 26215 / 2**18 - 0.1000015

RULES = {
    # a number as a word, and that word at a coarser scale, where it is 4915 / 2^14
    "number": ("where(u > 0, 0.3, fine)", LONG),
    "number at another scale": ("where(u > 0, 0.3, w)", 0.3 - 4915 / 2**14),
    "number in a sum": ("0.5 * u + 0.3", 0.3 - 9830 / 2**15),
    "number in a comparison": ("min(u, 0.3)", 0.3 - 4915 / 2**14),
    "number before what is compared": ("max(-0.3, u)", 0.3 - 4915 / 2**14),
    "a term whose coefficient is 0": ("0.5 + 3e-10 * u", 3e-10),
    # a number above all values of the integers, which the real value passes; in a word it is less
    "greater than all": (NUMBER, SHORT),
    "less than all": ("min(0.1 * u, -0.099999)", SHORT),
    "greater than all, below a number": (f"min({NUMBER}, 0.5)", SHORT),
    "greater than all, below a signal": (f"min({NUMBER}, near)", SHORT),
    # `near` ends between what the integers and what the real numbers have there
    "lesser first": (DECIDED, PASSED),
    "lesser second": ("min(0.2000015 - 0.1 * w, near)", PASSED),
    "greater first": ("max(near, 0.1 * w - 0.2000015)", PASSED),
    "greater second": ("max(0.1 * w - 0.2000015, near)", PASSED),
    "a size": ("abs(0.1 * u)", SHORT),
    "the other choice": ("where(u > 0, fine, 0.3)", LONG),
    "a choice of numbers": (f"where(w > 0, {NUMBER}, 0.25)", 0.1 - (0.25 - 19661 / 2**17)),
    "a decision in doubt": (UNSURE, 0.9 - 26214 / 2**18),
    "a decision of numbers": (f"where({NUMBER} >= 0.0999995, 0.9, 0.1)", 0.9 - 26214 / 2**18),
    "a square of what is in doubt": (f"{UNSURE} * {UNSURE}", 0.8),
    "times a number": (f"w * {NUMBER}", SHORT),
    "a number times": (f"{NUMBER} * w", SHORT),
    "a number four times": (f"4 * {NUMBER}", 4 * SHORT),
    "a quarter of a number": (f"0.25 * {NUMBER}", SHORT / 4),
    "beside a number": (f"0.5 * fine + {NUMBER}", 0.1 - 209713 / 2**21),
    "a factor with an error": (f"w * {UNSURE} * u", 0.9 - 26214 / 2**18),
    "by a number": (f"0.07 * u / {NUMBER}", 22938 / 2**15 - 0.7),
    "a function of a number": (f"sin({NUMBER})", math.sin(0.1) - 26170 / 2**18),
    # the choices are 5/8 of what decides apart
    "choices that meet where they are decided": (
        f"where({DOUBTED}, u / 16, 3.90625 * fine + 0.0014640625)",
        0.0625 - 3.90625 / 64 - 0.0014640625,
    ),
    "a product with a decision": (f"where({DOUBTED}, 0.9, 0.1) * w", 0.9 - 3277 / 2**15),
    "a decision times what has an error": (f"where(u > 0, 0.5, 0.25) * {LIMITED}", PASSED / 2),
    # the words of the centres are -4915 and 3277, for -4915.2 and 3276.64
    "degrees between rounded centres": ("part(sets(u), 1)", 0.3 / 0.49999 - 4915 / 8192),
    "degrees of what has an error": (f"part(narrow({LIMITED}), 1)", 4 * PASSED),
    "a degree that is 0 throughout": (
        "part(beside(near), 1)",
        (26215 / 2**18 - 0.100001) / (6553 / 2**18),
    ),
    "a table of one value": ("sigmoid(flat)", 1 / (1 + math.exp(-13)) - 32767 / 2**15),
    # no value comes near 5: nothing is in doubt, and nothing is added to what 0.3·u has
    "a limit far away": ("where(0.3 * u > 5, 1, 0.5)", 0.0),
    "kept below a limit far away": ("min(0.3 * u, 5)", LONG),
    "kept above a limit far away": ("max(0.3 * u, -5)", LONG),
}


FAR = """\
msnn: 1
name: far
sample_time: 10 ms
inputs: {u: {range: [-1e9, 1e9]}, w: {range: [-1e-12, 1e-12]}}
outputs: {both: "concat(u, w)"}
"""


def _proved_and_seen(folder: Path, text: str, width: Width) -> dict[str, tuple[float, float]]:
    """Of outputs and states: what is proved of a step from 0, and the most at ends of ranges."""
    program = planned(fixed_model(folder, text, width.name)).program
    integers = integer_program(program, initial_weights(program), width)
    stepper = ExactStepper(program, initial_weights(program))
    ports = {entry.port.name: entry.port for entry in integers.inputs}
    seen = dict.fromkeys((bound.name for bound in integers.step_errors), 0.0)
    for ends in product(*((port.low, max(port.low, 0), port.high) for port in ports.values())):
        words = dict(zip(ports, ends, strict=True))
        state = initial(integers)
        answer = step(integers, state, {name: [word] for name, word in words.items()})
        given = {n: np.array([math.ldexp(w, -ports[n].fraction)]) for n, w in words.items()}
        zeros = {memory.name: np.zeros(1) for memory in integers.memories}
        exact = stepper.steps(given, zeros, 1)
        found = [(p.name, answer.outputs[p.name], p.fraction) for p, _ in integers.outputs]
        found += [(m.name, state.memories[m.name], m.fraction) for m in integers.memories]
        for name, values, fraction in found:
            wanted = {**exact.outputs, **exact.next_states}[name].ravel()
            off = np.abs(np.ldexp(np.array(values, float), -fraction) - wanted).max()
            seen[name] = max(seen[name], float(off))
    return {bound.name: (bound.largest, seen[bound.name]) for bound in integers.step_errors}


@pytest.mark.parametrize("rule", RULES)
def test_an_error_is_what_is_proved_of_its_rule(rule: str, tmp_path: Path) -> None:
    formula, error = RULES[rule]
    proved, seen = _proved_and_seen(tmp_path, STATE.replace("FORMULA", formula), Q15)["x"]
    # a number in a sum adds a thousandth, of its last bit
    assert seen == pytest.approx(error, rel=2e-3, abs=1e-12)
    assert seen <= proved + 1e-12
    # a number at another scale is rounded twice, to a word before
    assert proved <= 1.6 * error + 1e-12


def test_rounded_choices_of_a_sum_of_decisions_count_in_its_product(tmp_path: Path) -> None:
    """No decision is in doubt: what rounds are the four numbers, of which words have 16 bits."""
    formula = "(where(w > 0, 0.3, 0.7) + where(fine > 0, 0.1, 0.2)) * u"
    proved, seen = _proved_and_seen(tmp_path, STATE.replace("FORMULA", formula), Q15)["x"]
    assert 2**-17 < seen <= proved < 2**-14


def test_the_end_of_a_range_that_no_word_meets_is_off_by_their_distance(tmp_path: Path) -> None:
    spec = STATE.replace("FORMULA", "u").replace("[-1, 1], init", "[-0.3, 0.3], init")
    proved, seen = _proved_and_seen(tmp_path, spec, Q15)["x"]
    assert proved == pytest.approx(0.3 - math.floor(0.3 * 2**30) / 2**30, rel=1e-4)
    assert seen == pytest.approx(proved, rel=1e-4)


def test_a_state_that_rounding_alone_starts_anew_has_no_bound(tmp_path: Path) -> None:
    spec = STATE.replace("FORMULA", "0.3 * u")
    spec = spec.replace("[-1, 1], init: 0", "[-0.3000015, 0.3000015], init: 0, on_range: reset")
    proved, seen = _proved_and_seen(tmp_path, spec, Q15)["x"]
    assert seen == pytest.approx(0.3)
    assert proved == math.inf


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
def test_what_lies_below_all_bits_of_its_neighbour_is_0_and_off_by_all_of_it(
    width: Width, tmp_path: Path
) -> None:
    proved, seen = _proved_and_seen(tmp_path, FAR, width)["both"]
    assert seen == pytest.approx(1e-12, rel=1e-4)
    assert seen <= proved < 1.001e-12


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
def test_a_shift_takes_all_bits_of_a_sum_but_two_and_room_for_half_a_unit(width: Width) -> None:
    """In C the unit of a shift is a number of its own, which a sum must hold."""
    most = width.sum - 2
    room = width.largest_sum - 2 ** (most - 1)
    builder = IntegerBuilder(width)
    word = builder.word("u", 0, 0, -1, 1)
    widest = builder.weighted_sum(0, [(2, word)], most, (-room, room))
    shifted = builder[builder.to_fraction(widest, 0)]
    assert (shifted.op, shifted.low, shifted.high) == (RoundShift(most), -1, 1)
    assert builder[builder.to_fraction(widest, -1)].op == Literal(0)
    too_wide = builder.weighted_sum(0, [(3, word)], most, (-room, room + 1))
    with pytest.raises(CannotFitError):
        builder.to_fraction(too_wide, 0)


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
def test_a_table_that_could_overflow_between_its_values_is_not_built(width: Width) -> None:
    """rise · part + half: part is below 2^bits, and half of that is added to round."""
    bits, word = width.word, width.largest_word
    rise = (width.largest_sum - 2**bits // 2) // (2**bits - 1)
    builder = IntegerBuilder(width)
    argument = builder.word("u", 0, 0, 0, word)
    builder.lookup(argument, IntegerLookup(0, bits, (0, rise), "steep"), 0)
    with pytest.raises(CannotFitError):
        builder.lookup(argument, IntegerLookup(0, bits, (0, -rise - 1), "steep"), 0)


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
@pytest.mark.parametrize("end", [0.0624, 0.03124, 0.0019531248, 2.0**-10 * (1 - 1e-8)])
def test_a_nearly_straight_function_has_a_table_that_fits(
    end: float, width: Width, tmp_path: Path
) -> None:
    """With two cells as wide as a word it was refused: it needs more than 32 bits."""
    spec = STATE.replace("FORMULA", "tan(flat)").replace("[12, 13]", f"[-{end}, {end}]")
    proved, seen = _proved_and_seen(tmp_path, spec, width)["x"]
    # the table may be off by 2^-10 or 2^-19 of the function's span
    assert seen <= proved
    assert seen < end * 2.0 ** (-9 if width is Q15 else -18)


@pytest.mark.parametrize(("width", "bend"), [(Q15, 3e-4), (Q31, 1e-6)], ids=["q15", "q31"])
def test_a_cell_is_narrower_than_a_word(width: Width, bend: float) -> None:
    """As wide, a cell that goes on beyond all words rises by more than a product has bits for."""
    end, builder = width.largest_word, IntegerBuilder(width)

    def straight(x: Any) -> Any:
        return (0.5 + bend) * x + 2 * bend

    found = fitted_table("sin", straight, width, (-end, end, width.word - 1))
    argument = builder.word("u", 0, width.word - 1, -end, end)
    builder.lookup(argument, found.table, found.fraction)
    assert found.table.bits == width.word - 1


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
@pytest.mark.parametrize("end", [1e-5, 1e-12, 1e-25])
def test_a_small_range_has_all_bits_of_a_word(end: float, width: Width, tmp_path: Path) -> None:
    """Its scale was that of 2^-16, or 2^-32: what is as small as picofarads was 0 throughout."""
    spec = STATE.replace("FORMULA", f"flat * {0.5 / end}").replace("[12, 13]", f"[-{end}, {end}]")
    program = planned(fixed_model(tmp_path, spec, width.name)).program
    (port,) = (e.port for e in integer_program(program, initial_weights(program), width).inputs)
    assert width.largest_word // 2 < port.high == -port.low
    proved, seen = _proved_and_seen(tmp_path, spec, width)["x"]
    assert seen <= proved < 2.0 ** (2 - width.word)


def test_a_table_may_be_off_between_the_words_that_were_tried() -> None:
    """A function that is 0 at each word that is tried, as steep as sin between them."""
    end = Q31.largest_word
    tried = np.round(np.linspace(-end, end, 2**16 + 1))

    def hidden(x: Any) -> Any:
        words = np.asarray(x) * 2.0**31
        after = np.clip(np.searchsorted(tried, words), 1, len(tried) - 1)
        return np.minimum(abs(words - tried[after - 1]), abs(tried[after] - words)) * 2.0**-31

    found = fitted_table("sin", hidden, Q31, (-end, end, 31))
    assert set(found.table.values) == {0}
    assert hidden((tried[7] + tried[8]) * 2.0**-32) == pytest.approx(2.0**-16, rel=1e-3)
    assert found.error >= hidden((tried[7] + tried[8]) * 2.0**-32)

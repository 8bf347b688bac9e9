"""Specs with a fault become small: moves of the shrinker, and how few trials they take."""

from __future__ import annotations

from tests.random_specs.generate import random_spec
from tests.random_specs.random_spec import RandomSpec
from tests.random_specs.shrink import shrunk
from tests.random_specs.terms import Term
from tests.random_specs.trial import Fault, fault_of

WRONG = Fault("show", "wrong", "")


def test_what_a_change_leaves_without_use_goes_with_it() -> None:
    spec = RandomSpec(
        {
            "inputs": {"u": {}, "v": {}},
            "parameters": {"p": {"init": 1.0}, "q": {"init": Term("2 * {0}", (Term("p"),))}},
            "outputs": {"y": Term("{0} * {1}", (Term("q"), Term("u"))), "z": Term("u")},
        }
    )
    without = RandomSpec({**spec.sections, "outputs": {"z": Term("u")}})
    assert spec.without_unnamed().sections["parameters"] == spec.sections["parameters"]
    assert without.without_unnamed().sections == {
        "inputs": {"u": {}},
        "outputs": {"z": Term("u")},
    }


def test_what_an_equation_says_comes_in_place_of_its_name() -> None:
    spec = RandomSpec(
        {
            "equations": {"e": {"expr": Term("tan({0})", (Term("u"),)), "history": 0}},
            "outputs": {"y": Term("2 * {0}", (Term("e"),))},
        }
    )
    said = [str(each.sections["outputs"]) for each in spec.smaller() if "outputs" in each.sections]
    assert any("tan" in str(outputs) and "2 *" in str(outputs) for outputs in said)
    texts = [each.texts()["spec.msnn.yaml"] for each in spec.smaller()]
    assert any('y: "2 * tan(u)"' in text and "e:" not in text for text in texts)


def test_a_fault_in_one_of_two_files_needs_no_other() -> None:
    part = RandomSpec(
        {
            "name": "part",
            "inputs": {"u": {}},
            "outputs": {"y1": Term("tan({0})", (Term("u"),))},
        }
    )
    spec = RandomSpec(
        {
            "name": "random",
            "use": {"inner": {"spec": "part.msnn.yaml"}},
            "inputs": {"u": {}},
            "connect": {"inner.u": Term("cosh({0})", (Term("u"),))},
            "outputs": {"y": Term("sinh({0})", (Term("inner.y1"),))},
        },
        {"part.msnn.yaml": part},
    )
    whole = {"name": "random"}
    alone = {"inputs": {"u": {}}, "outputs": {"y1": Term("tan({0})", (Term("u"),))}}
    without = {"inputs": {"u": {}}, "outputs": {"y": Term("sinh({0})", (Term("0.3"),))}}
    smaller = [(dict(less.sections), dict(less.parts)) for less in spec.smaller()]
    assert ({**whole, **alone}, {}) in smaller
    assert ({**whole, **without}, {}) in smaller


def test_a_fault_of_layers_is_found_small_within_few_trials() -> None:
    """As if every right spec that calls a fuzzify layer in an output or a state were wrong."""
    trials = 0

    def fault_of_sets(spec: RandomSpec) -> Fault | None:
        nonlocal trials
        text = spec.texts()["spec.msnn.yaml"]
        if "fuzzify" not in text or "phi" not in text.partition("states:")[2]:
            return None
        trials += 1
        return fault_of(spec, targets=(), kernel=False) or WRONG

    seed = next(s for s in range(200) if fault_of_sets(random_spec(s)) == WRONG)
    trials = 0
    small = shrunk(random_spec(seed), WRONG, fault_of_sets, 600.0)
    text = small.texts()["spec.msnn.yaml"]
    assert len(text.splitlines()) <= 15, text
    assert trials < 300

"""Identifiers made of hostile names: always legal, never twice the same."""

import re

import pytest

from backends.ports.identifiers import LONGEST, ascii_text, c_identifier


@pytest.mark.parametrize(
    ("name", "identifier"),
    [
        ("F", "F"),
        ("vehicle.rho_hat", "vehicle_rho_hat"),
        ("vehicle.ρ_hat", "vehicle_rho_hat"),
        ("λ", "lambda"),
        ("Ω", "Omega"),
        ("ώ", "omega"),
        ("é", "e"),
        ("int", "int_"),
        ("class", "class_"),
        ("linux", "linux_"),
        ("9lives", "v_9lives"),
        ("__x__", "x"),
        ("", "v"),
        ("*/ #error", "error"),
        ("中", "v"),
        ("x\n\\", "x"),
    ],
)
def test_spelling(name: str, identifier: str) -> None:
    assert c_identifier(name, set()) == identifier


def test_taken_names_get_a_number_and_are_remembered() -> None:
    taken = {"x"}
    assert [c_identifier("x", taken) for _ in range(3)] == ["x_2", "x_3", "x_4"]
    assert taken == {"x", "x_2", "x_3", "x_4"}


def test_numbers_that_are_kept_change_no_name() -> None:
    names = ["c", "x", "c", "c_2", "int", "c", "int", "c.2", "a" * 500, "x", "c", "a" * 500, "c"]
    plain, kept, numbers = {"c_4"}, {"c_4"}, dict[str, int]()
    made = [c_identifier(name, kept, numbers) for name in names]
    assert made == [c_identifier(name, plain) for name in names]
    assert len(set(made)) == len(names)


def test_long_names_are_cut_and_stay_apart() -> None:
    taken: set[str] = set()
    made = [c_identifier("a" * 500, taken) for _ in range(12)]
    assert len(set(made)) == 12
    assert all(len(identifier) <= LONGEST for identifier in made)


def test_every_character_gives_a_legal_identifier() -> None:
    for code in range(0x3000):
        identifier = c_identifier(chr(code) + "?", set())
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", identifier), hex(code)
        assert "__" not in identifier


def test_ascii_text_keeps_ascii_and_spells_the_rest() -> None:
    assert ascii_text("ρ in µm/°, 中") == "rho in um/deg, U+4E2D"

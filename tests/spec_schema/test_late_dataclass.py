"""A dataclass that is finished late does all that one of the standard library does, on any use."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, field, fields, replace
from inspect import signature
from threading import Barrier
from typing import Any, ClassVar

import pytest

from spec_schema.late_dataclass import dataclass

_OPTIONS: Sequence[dict[str, bool]] = (
    {"frozen": True, "slots": True},
    {"frozen": True, "slots": True, "kw_only": True},
    {"frozen": True, "slots": True, "order": True},
    {"frozen": True, "slots": True, "eq": False},
    {"frozen": True, "slots": True, "repr": False},
    {"frozen": True},
    {"slots": True},
    {},
)
_USES: dict[str, Callable[[type[Any]], Any]] = {
    "fields": lambda point: [(one.name, one.type, one.kw_only) for one in fields(point)],
    "signature": lambda point: str(signature(point)),
    "positions": lambda point: point.__match_args__,
    "repr": lambda point: repr(point(x=1)).startswith("Point(") and str(point(x=1)) > "",
    "equal": lambda point: (point(x=1) == point(x=1), point(x=1) == point(x=2)),
    "hash": lambda point: len({point(x=1, z=()), point(x=1, z=())}),
    "order": lambda point: (point(x=1) < point(x=2), point(x=1) >= point(x=2)),
    "assign": lambda point: setattr(point(x=1), "x", 2),
    "delete": lambda point: delattr(point(x=1), "x"),
    "replace": lambda point: asdict(replace(point(x=1), y=7)),
    "copy": lambda point: asdict(copy.deepcopy(point(x=[1]))),
    "dict": lambda point: hasattr(point(x=1), "__dict__"),
    "slots": lambda point: point.__dict__.get("__slots__"),
    "missing": lambda point: point(),
    "apart": lambda point: point(x=1).z is point(x=1).z,
    "more": lambda point: asdict(_more(point)(x=1, extra=5)),
}


def _point(decorate: Callable[..., Any], options: dict[str, bool]) -> type[Any]:
    @decorate(**options)
    class Point:
        count: ClassVar[int] = 3
        x: Any
        y: int = 2
        z: Any = field(default_factory=list[int])

    return Point


def _more(point: type[Any]) -> type[Any]:
    @dataclasses.dataclass(frozen=point.__dataclass_params__.frozen, kw_only=True)
    class More(point):
        extra: int

    return More


def _outcome(use: Callable[[type[Any]], Any], point: type[Any]) -> Any:
    try:
        return use(point)
    except (TypeError, AttributeError) as error:
        return type(error), str(error).replace(point.__qualname__, "")


@pytest.mark.parametrize("use", _USES)
@pytest.mark.parametrize("options", _OPTIONS, ids=" ".join)
def test_whatever_is_used_first_is_as_in_the_standard_library(options: dict[str, bool], use: str):
    late, at_once = (_point(make, options) for make in (dataclass, dataclasses.dataclass))
    assert _outcome(_USES[use], late) == _outcome(_USES[use], at_once)


@pytest.mark.parametrize("first", _USES)
@pytest.mark.parametrize("options", _OPTIONS, ids=" ".join)
def test_whatever_is_used_second_too(options: dict[str, bool], first: str):
    at_once = _point(dataclasses.dataclass, options)
    expected = {use: _outcome(_USES[use], at_once) for use in _USES}
    for second in _USES:
        late = _point(dataclass, options)
        for use in (first, second):
            assert _outcome(_USES[use], late) == expected[use], (first, second)
        assert repr(late.__dataclass_params__) == repr(at_once.__dataclass_params__)


@dataclass(frozen=True, slots=True)
class _Base:
    x: int


@dataclass(frozen=True, slots=True)
class _Derived(_Base):  # noqa: PLW1641  (a frozen one has its hash written)
    y: int = 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Derived) and self.x == other.x


def test_a_derived_class_finishes_its_base_and_keeps_what_it_has():
    assert (_Derived(1, 2), hash(_Derived(1))) == (_Derived(1, 3), hash((1, 0)))
    match _Derived(1, 2):
        case _Derived(x, y):
            assert (x, y) == (1, 2)


@pytest.mark.parametrize("use", [repr, hash, lambda sent: sent == sent], ids=["repr", "hash", "eq"])
def test_another_process_may_be_sent_one_before_it_makes_one(use: Callable[[Any], Any]):
    @dataclass(frozen=True, slots=True)
    class Sent:
        x: int

    sent = object.__new__(Sent)
    object.__setattr__(sent, "x", 1)
    assert use(sent) == use(Sent(1))


def test_a_copy_gets_its_state_though_it_is_frozen():
    sent = object.__new__(_Derived)
    sent.__setstate__([1, 2])  # pyright: ignore
    assert (sent.x, sent.y) == (1, 2)


def test_threads_may_use_one_first_at_once():
    for _ in range(20):
        made = _point(dataclass, {"frozen": True, "slots": True})
        start = Barrier(8)

        def use(number: int, made: type[Any] = made, start: Barrier = start) -> bool:
            start.wait()
            return made(number, z=()) == made(number, z=()) and hash(made(number, z=())) != 0

        with ThreadPoolExecutor(8) as threads:
            assert all(threads.map(use, range(8)))


def test_nothing_is_written_before_it_is_used():
    made = _point(dataclass, {"frozen": True, "slots": True})
    assert not callable(vars(made)["__init__"])
    one = made(1, z=())
    assert callable(vars(made)["__init__"])
    waits = vars(made)["__eq__"], vars(made)["__hash__"]
    assert one == one
    assert {*waits}.isdisjoint((vars(made)["__eq__"], vars(made)["__hash__"]))


_COMPARED: dict[str, Callable[[Any], Any]] = {
    "hash": hash,
    "equal": lambda point: point == type(point)(x=1, z=()),
    "repr": repr,
    "make": lambda point: type(point)(x=2),
    "fields": lambda point: fields(type(point)),
}


@pytest.mark.parametrize("use", _COMPARED)
def test_ctrl_c_while_a_method_is_written_is_ctrl_c(
    use: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python would take it for a method that is not there, and call the object unhashable."""
    point = _point(dataclass, {"frozen": True, "slots": True})
    written = dataclasses.dataclass
    made = point(x=1, z=()) if use not in ("make", "fields") else object.__new__(point)

    def interrupted(**options: bool) -> Callable[[type[Any]], type[Any]]:
        def late(of: type[Any]) -> type[Any]:
            written(**options)(of)  # it has taken defaults from the class
            raise KeyboardInterrupt

        return late

    monkeypatch.setattr(dataclasses, "dataclass", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _COMPARED[use](made)
    monkeypatch.undo()
    whole = point(x=1)
    assert repr(whole).endswith("Point(x=1, y=2, z=[])")
    assert whole == point(x=1)
    assert hash(point(x=1, z=())) == hash(point(x=1, z=()))

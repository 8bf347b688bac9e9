"""Draws a whole spec from a seed: signals, states, equations, outputs, losses, a stage, a part."""

from __future__ import annotations

import random
from typing import Any

from tests.random_specs.expressions import expression
from tests.random_specs.random_spec import RandomSpec
from tests.random_specs.scope import DIMS, Scope, Value
from tests.random_specs.terms import SCALAR, Shape, Term, leaf

UNITS = (None, None, None, "m", "V", "rad", "m/s", "N*m")
INTEGRATORS: tuple[Any, ...] = (
    *("euler", "semi_implicit", "linear_implicit", "midpoint", "rk4"),
    {"rk4": {"substeps": 2}},
    {"euler": {"substeps": 3}},
)
PART = "part.msnn.yaml"


def random_spec(seed: int) -> RandomSpec:
    """The spec of a seed; most of them are right, and always the same."""
    chance = random.Random(f"spec {seed}")
    is_static = chance.random() < 0.1
    has_part = not is_static and chance.random() < 0.2
    writer = _Writer(chance, is_static=is_static)
    parts: dict[str, RandomSpec] = {}
    if has_part:
        part = _Writer(chance, is_static=False, is_part=True)
        parts[PART] = RandomSpec(part.written())
        writer.use(part)
    return RandomSpec(writer.written(), parts)


class _Writer:
    """Writes the sections one after the other; each reads what those before declared."""

    def __init__(self, chance: random.Random, *, is_static: bool, is_part: bool = False) -> None:
        self.sections: dict[str, Any] = {"msnn": 1, "name": "part" if is_part else "random"}
        if not is_static:
            self.sections["sample_time"] = "100 ms"
        self.sections["dims"] = dict(DIMS)
        self.is_static, self.is_part = is_static, is_part
        self.chance = chance
        self.scope = Scope(chance, self.sections, memory=not is_static, previews=not is_static)
        self._inputs()

    def written(self) -> dict[str, Any]:
        """All sections."""
        states = [] if self.is_static else self._state_names()
        for _ in range(self.chance.choice((0, 1, 1, 2, 3))):
            self._equation()
        for state in states:
            self._state(state)
        if any("der" in state for state in self.sections.get("states", {}).values()):
            self.sections["integrator"] = self.chance.choice(INTEGRATORS)
        for name, shape, _ in states:
            if "der" in self.sections["states"][name]:
                self.scope.values.append(Value(f"der({name})", shape, False, False, varies=False))
        for number in range(self.chance.choice((1, 1, 2))):
            self._output(number)
        if not self.is_part:
            self._workflow()
        return self.sections

    def use(self, part: _Writer) -> None:
        """Takes another spec as a part: one of its inputs is connected, its results are read."""
        self.sections["use"] = {"inner": {"spec": PART}}
        if self.chance.random() < 0.3:
            self.sections["use"]["inner"]["freeze"] = self.chance.choice(("all", "none"))
        if self.chance.random() < 0.3:
            self.sections["use"]["other"] = {"spec": PART}
        # what is fed back has no future, and a part may read that of its inputs
        known = [value for value in self.scope.values if value.name != "v"]
        scope = self.scope.restricted(pure=True, memory=False, previews=False, values=known)
        for name in self.sections["use"]:
            connected = self.sections.setdefault("connect", {})
            connected[f"{name}.u"] = expression(scope, SCALAR, 2)
            for output, shape in part.shapes.items():
                value = Value(f"{name}.{output}", shape, from_inputs=False, has_past=False)
                self.scope.values.append(value)

    shapes: dict[str, Shape]
    """Of outputs, by name."""

    def _inputs(self) -> None:
        self.shapes = {}
        names = ["u", "v", "q", "r"][: self.chance.choice((2, 3, 3, 4))]
        self.sections["inputs"] = {}
        for name in names:
            shape = SCALAR if name in "uv" else self._shape(1)
            entry: dict[str, Any] = {"range": [-1.5, 1.5]} if self.chance.random() < 0.3 else {}
            if shape.dims:
                entry["dims"] = sorted(shape.dims)
            unit = self.chance.choice(UNITS)
            if unit is not None:
                entry["unit"] = unit
            if "range" in entry:
                entry["on_invalid"] = self.chance.choice(("clamp", "hold", "flag", "trust"))
            if (
                not self.is_static and name != "v"
            ):  # what is fed back has no line to its next sample
                between = self.chance.choice((None, None, "hold", "linear", "linear"))
                entry |= {"between": between} if between else {}
            self.sections["inputs"][name] = entry
            past = not self.is_static
            # a signal that is predicted can be fed back: nobody may know its future
            self.scope.values.append(Value(name, shape, True, past, logged=past and name != "v"))

    def _shape(self, most: int) -> Shape:
        dims = sorted(DIMS)
        count = self.chance.choice((0, 0, 1, 1, 2)[: 3 + most])
        return Shape(frozenset(self.chance.sample(dims, min(count, most))))

    def _state_names(self) -> list[tuple[str, Shape, bool]]:
        """Declares states that anything may read, before what they are is drawn."""
        found: list[tuple[str, Shape, bool]] = []
        for number in range(self.chance.choice((0, 1, 1, 2))):
            name, shape = f"x{number + 1}", self._shape(1)
            has_history = self.chance.random() < 0.4
            found.append((name, shape, has_history))
            self.scope.values.append(Value(name, shape, False, has_history))
        return found

    def _depth(self) -> int:
        return self.chance.choice((1, 2, 2, 3))

    def _state(self, state: tuple[str, Shape, bool]) -> None:
        name, shape, has_history = state
        scope = self.scope
        entry: dict[str, Any] = {"dims": sorted(shape.dims)} if shape.dims else {}
        kind = self.chance.choice(("next", "der", "der", "both"))
        if kind != "next":
            inner = expression(scope.restricted(previews=False), shape, self._depth())
            entry["der"] = Term(f"tanh({{0}}) - 0.8 * {name}", (inner,))
        if kind == "next":
            inner = expression(scope, shape, self._depth())
            entry["next"] = Term(f"0.6 * {name} + 0.3 * tanh({{0}})", (inner,))
        elif kind == "both":
            entry["next"] = leaf(f"clip(flow({name}), -1.37, 1.21)")
        entry["init"] = self.chance.choice(
            (
                0.2,
                leaf("0.4 * u"),
                leaf("tanh(u[t-1])"),
                leaf(f"{name}.meas"),
                leaf(f"0.5 * ({name}.meas[t] + {name}.meas[t-1])"),
                Term("0.3 * {0}", (scope.parameter(Shape()),)),
            )
        )
        if has_history:
            entry["history"] = self.chance.choice((0, 0.1, leaf("0.2 * u")))
        if self.chance.random() < 0.3:
            entry["range"] = [-5, 5]
            policies = (
                ("flag", "saturate", "reset") if entry["init"] == 0.2 else ("flag", "saturate")
            )
            if self.chance.random() < 0.6:
                entry["on_range"] = self.chance.choice(policies)
        self.sections.setdefault("states", {})[name] = entry

    def _equation(self) -> None:
        scope, shape = self.scope, self._shape(2)
        is_pure = self.is_static or self.chance.random() < 0.5
        inner = scope.restricted(pure=True, memory=False) if is_pure else scope
        inner = inner.restricted(previews=False)
        term = expression(inner, shape, self._depth())
        entry: Any = term
        has_past = is_pure and not self.is_static
        if not is_pure and self.chance.random() < 0.4:
            entry, has_past = {"expr": term, "history": 0.1}, True
        if self.chance.random() < 0.2:
            entry = {**(entry if isinstance(entry, dict) else {"expr": term}), "range": [-2, 2]}
        name = scope.declare("equations", "e", entry)
        scope.values.append(Value(name, shape, is_pure, has_past, varies=is_pure))

    def _output(self, number: int) -> None:
        scope, name = self.scope, f"y{number + 1}"
        shape = self._shape(2)
        states = self.sections.get("states", {})
        predicts = None if self.is_part or self.is_static else self.chance.choice((None, "v", "v"))
        if predicts and number == 0:
            shape = SCALAR
        term = expression(scope, shape, self._depth() + 1)
        if states and not self.is_part and self.chance.random() < 0.4:
            state = self.chance.choice(sorted(states))
            if not states[state].get("dims"):
                term = Term(f"0.5 * ({{0}}) + next({state})", (term,))
        entry: dict[str, Any] = {"expr": term}
        if predicts and number == 0:
            entry = {"expr": Term("0.6 * v + 0.3 * tanh({0})", (term,)), "predicts": "v[t+1]"}
        self.shapes[name] = shape
        self.sections.setdefault("outputs", {})[name] = entry

    def _workflow(self) -> None:
        chance, outputs = self.chance, self.sections["outputs"]
        predicted = any("predicts" in entry for entry in outputs.values())
        if not predicted or chance.random() < 0.5:
            self.sections["targets"] = {"z": {}}
            measure = chance.choice(("mse", "mae", "rmse", "huber"))
            delta = ""
            if measure == "huber" and chance.random() < 0.5:
                delta = f", delta={chance.choice(('0.25', '1.5', '2 / 3'))}"
            losses: dict[str, Any] = {"fit": leaf(f"{measure}(y1, z{delta})")}
            if chance.random() < 0.3:
                losses["small"] = {"expr": leaf("l2(y1)"), "weight": 0.1}
            if chance.random() < 0.3:
                losses["cost"] = Term("0.1 * y1 ** 2")
            if chance.random() < 0.2:
                losses["sum"] = Term("mse(y1, z) + 0.2 * l1(y1)")
            if not self.is_static:
                losses |= self._losses_in_time()
            self.sections["losses"] = losses
        stage: dict[str, Any] = {"epochs": 2, "dtype": "float64", "batch": 8}
        stage["optimizer"] = chance.choice(
            ({"adam": {"lr": 0.01}}, {"sgd": {"lr": 0.01}}, {"adamw": {"lr": 0.01}})
        )
        if not self.is_static:
            stage["rollout"] = chance.choice((1, 5, {"horizon": 8, "skip": 2}))
            if predicted and chance.random() < 0.2:
                stage["rollout"] = {"horizon": 6, "close": []}
        learned = [n for n, p in self.sections.get("parameters", {}).items() if _is_learned(p)]
        if len(learned) > 1 and chance.random() < 0.3:
            stage["freeze"] = [chance.choice(learned)]
        elif learned and chance.random() < 0.3:
            stage["lr"] = {chance.choice(learned): 0.5}
        if chance.random() < 0.9:
            self.sections["train"] = [stage]
        export = self._export(predicted)
        if export:
            self.sections["export"] = export

    def _losses_in_time(self) -> dict[str, Any]:
        """Losses that look along the log."""
        chance, found = self.chance, dict[str, Any]()
        if chance.random() < 0.2:
            found["slope"] = leaf("mse(y1, der(v.meas, method=central))")
        if chance.random() < 0.2:
            found["area"] = leaf("0.1 * l2(integral(y1 - z))")
        for name in self.sections.get("states", {}):
            if chance.random() < 0.2:
                found[f"of_{name}"] = leaf(f"mse(next({name}), {name}.meas[t+1])")
        shape = self.shapes["y1"]
        if len(shape.dims) == 1 and chance.random() < 0.5:
            self.sections["targets"]["shares"] = {"dims": sorted(shape.dims)}
            found["classes"] = leaf("cross_entropy(y1, shares)")
        return found

    def _export(self, predicted: bool) -> dict[str, Any]:
        chance, found = self.chance, dict[str, Any]()
        if chance.random() < 0.5:
            found["c"] = self._c_export()
        if predicted and chance.random() < 0.4:
            for target in ("torch", "onnx", "casadi", "c"):
                found.setdefault(target, {})["close"] = ["v"]
        if len(self.sections["outputs"]) > 1 and chance.random() < 0.3:
            found.setdefault("torch", {})["outputs"] = ["y2"]
            found.setdefault("c", {})["outputs"] = ["y2"]
        return found

    def _c_export(self) -> dict[str, Any]:
        chance = self.chance
        entry: dict[str, Any] = {
            "params": chance.choice(("const", "tunable", "inline")),
            "ring": chance.choice(("auto", "double", "shift")),
            "unroll": chance.choice((1, 4, 8)),
        }
        if chance.random() < 0.3:
            entry["constant_time"] = True
        if chance.random() < 0.4:
            entry["with"] = [chance.choice(("jacobian", "state_jacobian"))]
        if chance.random() < 0.3:
            entry["dtype"] = "float64"
        return entry


def _is_learned(parameter: Any) -> bool:
    return not isinstance(parameter, dict) or parameter.get("learn", True) is True

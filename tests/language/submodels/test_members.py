"""R11: what `use` brings, under which names, and what stays behind."""

from pathlib import Path

import numpy as np

from tests.language.submodels.submodels import diagnostics, model_of, names, run, write_weights

GAIN = """
    inputs: {u: V}
    parameters: {k: 2}
    outputs: {y: k * u}
    """


def test_two_instances_of_one_file_have_weights_of_their_own(tmp_path: Path) -> None:
    text = """
        use: {left: gain.yaml, right: gain.yaml}
        inputs: {u: V}
        connect: {left.u: u, right.u: left.y}
        outputs: {y: right.y}
        """
    program = model_of(tmp_path, text, gain=GAIN).program
    assert names(program)["parameters"] == ["right.k", "left.k"]
    assert names(program)["signals"] == ["u"]
    assert names(program)["outputs"] == ["y", "left.y", "right.y"]
    weights = {"left.k": 3.0, "right.k": 5.0}
    np.testing.assert_array_equal(run(program, {"u": [7.0]}, weights=weights), [105.0])


def test_parts_of_parts(tmp_path: Path) -> None:
    text = """
        use: {car: car.yaml}
        inputs: {v: m/s}
        connect: {car.v: v, car.tyre.load: 3}
        outputs: {y: car.force + car.tyre.mu}
        """
    car = """
        use: {tyre: tyre.yaml}
        inputs: {v: m/s}
        connect: {tyre.slip: 2 * v}
        outputs: {force: tyre.force}
        """
    tyre = """
        inputs: {slip: m/s, load: N}
        parameters: {mu: 0.5}
        functions: {pull: {args: [slip, x], expr: slip * x}}
        outputs: {force: "pull(load, slip) * mu"}
        """
    program = model_of(tmp_path, text, car=car, tyre=tyre).program
    # 3 · (2 · 4) · 0.5 + 0.5; the argument `slip` of the function is no signal
    np.testing.assert_array_equal(run(program, {"v": [4.0]}), [12.5])
    assert names(program)["parameters"] == ["car.tyre.mu"]


def test_inputs_that_nothing_feeds_are_inputs_of_the_model(tmp_path: Path) -> None:
    text = """
        use: {plant: plant.yaml}
        inputs: {u: V}
        connect: {plant.u: 10 * u}
        outputs: {y: plant.y + plant.d, z: plant.x_next}
        losses: {fit: "mse(plant.y, plant.y_ref)"}
        """
    plant = """
        inputs: {u: V, d: V}
        targets: {y_ref: V, other: V}
        states: {x: {next: x + u, init: x.meas}}
        outputs: {y: {expr: u + d, predicts: y_ref}, x_next: next(x)}
        losses: {own: "mse(y, other)"}
        """
    program = model_of(tmp_path, text, plant=plant).program
    found = {signal.name: signal.role.value for signal in program.signals}
    assert found == {"u": "input", "plant.d": "input", "plant.y_ref": "target", "plant.x": "target"}
    assert [loss.name for loss in program.losses] == ["fit"]
    assert all(output.predicts is None for output in program.outputs)
    log = {"u": [1.0, 2.0], "plant.d": [3.0, 4.0], "plant.y_ref": [0, 0], "plant.x": [5.0, 0.0]}
    np.testing.assert_array_equal(run(program, log, steps=2), [16.0, 28.0])
    np.testing.assert_array_equal(run(program, log, steps=2, output="z"), [15.0, 35.0])


def test_a_dimension_is_the_parents_where_the_sizes_agree(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        dims: {joint: 2, past: 3}
        inputs: {x: 1}
        constants: {w: {value: [1, 10], dims: joint}, v: {value: [1, 2, 3, 4], dims: part.past}}
        outputs: {y: w @ part.a + sum(part.b * v), z: part.second * x}
        """
    part = """
        dims: {joint: [first, second], past: 4}
        constants: {second: {value: [5, 6], dims: joint}}
        inputs: {}
        outputs:
          a: second
          b: {expr: c}
          second_of: part(second, second)
        equations: {c: d}
        parameters: {d: {dims: past, init: [1, 1, 1, 2]}}
        """
    program = model_of(tmp_path, text, part=part).program
    assert names(program)["dims"] == ["joint", "past", "part.past"]
    assert program.dimensions[0].labels == ("first", "second")
    # [1, 10] @ [5, 6] + 1 + 2 + 3 + 8
    np.testing.assert_array_equal(run(program, {"x": [1.0]}), [79.0])
    np.testing.assert_array_equal(run(program, {"x": [1.0]}, output="part.second_of"), [6.0])


def test_every_kind_of_member_is_named_with_its_sub_model(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {x: 1}
        connect: {part.x: x}
        outputs: {y: "part.h(x) + part.g(x, 2) + part.c + part.k + part.e[t-1] + part.n.inverse(x)"}
        """
    part = """
        inputs: {x: 1}
        constants: {c: 100}
        parameters: {k: 1000}
        layers: {h: {fir: {window: 2, init: [1, 2]}}, n: {normalize: {mean: 1, std: 2}}}
        functions: {g: {args: [a, b], expr: a * b * c}}
        equations: {e: 10000 * x}
        outputs: {y: n(x)}
        """
    program = model_of(tmp_path, text, part=part).program
    # (3 + 2·4) + 4·2·100 + 100 + 1000 + 10000·3 + (1 + 2·4)
    np.testing.assert_array_equal(run(program, {"x": [3.0, 4.0]}, t0=1), [31920.0])


def test_a_name_of_a_part_is_never_one_of_the_parent(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {x: 1, gain: 1}
        connect: {part.x: x}
        outputs: {y: part.y * gain}
        """
    found = diagnostics(tmp_path, text, part="inputs: {x: 1}\noutputs: {y: gain * x}\n")
    assert [d.code for d in found] == ["E0301"]
    # as the part's own file brings it, with the place of its use
    assert found[0].message == "unknown name `gain`"
    assert found[0].span is not None
    assert found[0].span.file == str(tmp_path / "part.yaml")
    assert [label for _, label in found[0].secondary] == ["used here as `part`"]


def test_terms_of_an_equation_learner_are_no_members(tmp_path: Path) -> None:
    text = """
        use: {p: learner.yaml}
        inputs: {u: V}
        connect: {p.u: u}
        outputs: {y: p.y}
        """
    functions = "[identity, neg, square, add, sub, mul, sin, own]"
    learner = f"""
        inputs: {{u: V}}
        functions: {{own: {{args: [a], expr: 2 * a}}}}
        layers: {{f: {{equation_learner: {{functions: {functions}, init: 1, bias: false}}}}}}
        outputs: {{y: f(u)}}
        """
    program = model_of(tmp_path, text, learner=learner).program
    weights = {"p.f.weight_in": np.ones((11, 1)), "p.f.weight_out": np.ones(8)}
    x = 0.7
    expected = x - x + x * x + 2 * x + 0 + x * x + np.sin(x) + 2 * x
    np.testing.assert_allclose(run(program, {"u": [x]}, weights=weights), [expected], rtol=1e-14)


def test_weights_and_freezing(tmp_path: Path) -> None:
    write_weights(tmp_path / "w.safetensors", {"k": 4.0, "h.weight": [1.0, 2.0]})
    part = """
        inputs: {x: 1}
        parameters: {k: {init: 3, max: 4.5}}
        layers: {h: {fir: {window: 2}}}
        outputs: {y: k * h(x)}
        """
    text = """
        use: {part: {spec: part.yaml, weights: w.safetensors, freeze: FREEZE}}
        inputs: {x: 1}
        parameters: {own: 1}
        connect: {part.x: x}
        outputs: {y: own * part.y}
        """
    for freeze, learned in (
        ("all", ["own"]),
        ("none", ["own", "part.k", "part.h.weight"]),
        ("[h.*]", ["own", "part.k"]),
        ("k", ["own", "part.h.weight"]),
    ):
        program = model_of(tmp_path, text.replace("FREEZE", freeze), part=part).program
        assert names(program)["parameters"] == learned, freeze
        np.testing.assert_array_equal(run(program, {"x": [10.0, 20.0]}, t0=1), [200.0])


def test_weights_of_the_outer_part_come_first(tmp_path: Path) -> None:
    write_weights(tmp_path / "outer.safetensors", {"k": 10.0, "free.k": 3.0})
    write_weights(tmp_path / "gain.safetensors", {"k": 7.0})
    outer = """
        use:
          free: {spec: gain.yaml, weights: gain.safetensors}
          held: {spec: gain.yaml, weights: gain.safetensors, freeze: all}
        inputs: {u: V}
        parameters: {k: 0}
        connect: {free.u: u, held.u: u}
        outputs: {y: k + 100 * free.y + 1000 * held.y}
        """
    text = """
        use: {outer: {spec: outer.yaml, weights: outer.safetensors}}
        inputs: {u: V}
        connect: {outer.u: u}
        outputs: {y: outer.y}
        """
    program = model_of(tmp_path, text, outer=outer, gain=GAIN).program
    assert names(program)["parameters"] == ["outer.k", "outer.free.k"]
    np.testing.assert_array_equal(run(program, {"u": [1.0]}), [10.0 + 300.0 + 7000.0])


def test_centers_of_fuzzy_sets_are_members_in_the_unit_of_their_calls(tmp_path: Path) -> None:
    text = """
        use: {p: part.yaml}
        inputs: {v: m/s}
        connect: {p.x: v}
        outputs: {far: "sum(p.phi.centers - v)"}
        """
    part = """
        inputs: {x: m/s}
        layers: {phi: {fuzzify: {centers: [0, 1, 3], learn: true}}}
        outputs: {y: sum(phi.offset(x))}
        """
    program = model_of(tmp_path, text, part=part).program
    assert {str(parameter.unit) for parameter in program.parameters} == {"m/s"}
    np.testing.assert_array_equal(
        run(program, {"v": [2.0], "p.x": [0.0]}, output="far"), [4.0 - 6.0]
    )

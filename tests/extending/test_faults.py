"""Mistakes of plug-ins are reported as theirs: the package, its version, the name and the line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from msnn.cli.application import run
from tests.extending.conftest import Install
from tests.extending.test_plugins import PLAIN, spec_file

RECORD = """
import math
import numpy as np
from pathlib import Path
from msnn.extending import *

class Limit(Entry):
    pass

class Other(Entry):
    pass

class Sheet(FloatTargetEntry):
    pass

def compile(entry, linked, program, compile_other):
    return CompiledSection(Problem(program))

class Problem:
    def __init__(self, program):
        self.program = program

def text(problem):
    return "a limit"

def names_used(entry):
    return ()

def expand(context, settings, arguments):
    return arguments[0]

def read(context, settings):
    return read_value(context, settings)

def twice(builder, x):
    return builder.add(x, x)

def prepare(request, entry):
    return float_plan(SHEET, request, entry)

def write(plan, weights, folder):
    file = folder / "a.txt"
    file.write_text("a")
    return (file,)

def faults(plan):
    return ()

load, settings, compiler, layer_rule = None, Limit, compile, LayerRule
REPLACED
LIMIT = Section(compile=compiler, text=text, names_used=names_used)
RULE = layer_rule(settings, read, expand)
SHEET = Target(name="sheet", entry=Sheet, dtype="float64", options=None, prepare=prepare,
               write=write, load=load, faults=faults)
HERE = "faulty"
FEATURE = Feature(
    name="faulty",
    sections=(SectionLine("limit", LateEntry(HERE, "Limit"), LateObject(HERE, "LIMIT"), ""),),
    layers=(LayerLine("plain_layer", LateEntry(HERE, "Limit"), LateObject(HERE, "RULE"), ""),),
    functions=(FunctionLine("twice", Signature(1, 1), LateObject(HERE, "twice")),),
    targets=(TargetLine("sheet", LateEntry(HERE, "Sheet"), LateObject(HERE, "SHEET"), "",
                        title="sheet", help=""),),
)
"""
SPEC = (
    PLAIN.replace("k * u", "twice(f(k * u))")
    + "layers: {f: {plain_layer: {}}}\nlimit: {}\nexport: {sheet: {}}\n"
)


@dataclass(frozen=True)
class Fault:
    """A change of the plug-in, the verb that meets it, and what the message says."""

    part: str
    change: str
    message: str
    verb: str = "show"


FAULTS = (
    Fault(
        "section `limit`",
        "def compiler(*_): raise KeyError('k')",
        "raised KeyError: 'k' (faulty, line 50, in compiler)",
    ),
    Fault("section `limit`", "def compiler(*_): raise SystemExit(3)", "raised SystemExit: 3"),
    Fault(
        "section `limit`",
        "def compiler(*_): return 3",
        "returned a int, not a CompiledSection",
    ),
    Fault(
        "section `limit`",
        "def compiler(*_): return CompiledSection(3)",
        "compiled to a int without a `program`",
    ),
    Fault(
        "section `limit`",
        "def compiler(e, l, program, o): return CompiledSection(Problem(program), ('no',))",
        "returned a warning that is no Diagnostic",
    ),
    Fault(
        "section `limit`",
        "def compiler(*_): raise SpecError([])",
        "raised a SpecError without an error: write `SpecError([error(...)])`",
    ),
    Fault("section `limit`", "def compiler(): pass", "raised TypeError: "),
    Fault("section `limit`", "def text(problem): return problem.size", "raised AttributeError"),
    Fault("section `limit`", "def text(problem): return None", "returned a NoneType, not a str"),
    Fault("section `limit`", "def names_used(entry): return 3", "raised TypeError"),
    Fault("layer `plain_layer`", "def read(c, s): return 3", "read a int, not a tuple of nodes"),
    Fault("layer `plain_layer`", "def expand(c, s, a): return a[1]", "raised IndexError"),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return None",
        "returned `None`, which is not a node of the builder",
    ),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return 10**6",
        "returned `1000000`, which is a number, not a node: write `builder.constant(1000000)`",
    ),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return c.builder.sum(a[0], 'gone')",
        "raised ValueError: the value is scalar, and has no axis `gone`",
    ),
    Fault(
        "layer `plain_layer`",
        "settings = Other",
        "has a rule for settings of Other, and the class of its line is Limit",
    ),
    Fault("layer `plain_layer`", "layer_rule = lambda *_: 3", "is a int, not a LayerRule"),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return c.builder.add(*(c.learned(f'w{n}', (Axis('i', n),), 0.0, 'x')"
        " for n in (2, 3)))",
        "raised AxisConflict: ",
    ),
    Fault("function `twice`", "def twice(builder): return 0", "raised TypeError"),
    Fault("function `twice`", "def twice(b, x): return 'x'", "returned `'x'`, which is not a node"),
    Fault("function `twice`", "def twice(b, x): return -1", "returned `-1`, which is a number"),
    *(
        Fault("function `twice`", f"def twice(b, x): return {formula}", message)
        for formula, message in {
            "b.multiply(x, 2)": "got `2`, which is a number, not a node: write `builder.constant(2",
            "b.add(x, 99)": "raised TypeError: got `99`, which is a number",
            "b.add(0.5, x)": "write `builder.constant(0.5)` (faulty, line 50, in twice)",
            "b.clamp(x, 0, 1)": "got `0`, which is a number",
            "b.apply('tanh', 2.0)": "got `2.0`, which is a number",
            "b.concat([x, 1], 'i')": "got `1`, which is a number",
            "b.add(x, None)": "got `None`, which is not a node",
            "b.add(x, [x])": "got a list, which is not a node",
            "b.power(x, x)": "a node is no exponent: write `builder.apply('pow', base, exponent)`",
            "b.power(x, 0.5)": "the exponent is `0.5`, not an integer",
            "2 * x": "a node has no value while a spec is compiled: write `builder.multiply(x, y)`",
            "x + x": "write `builder.add(x, y)`",
            "-x": "write `builder.negate(x)`",
            "x if x else x": "write `builder.compare` and `builder.select`",
            "b.constant(x)": "has no value while a spec is compiled",
            "np.tanh(x)": "raised TypeError",
            "b.constant(np.sqrt(2) * x)": "write `builder.multiply(x, y)`",
            "b.constant(math.sin(x))": "has no value while a spec is compiled",
            "[x for _ in range(x)][0]": "raised TypeError",
            "b.apply('tan_h', x)": "`tan_h` is no scalar function",
            "b.apply('atan2', x)": "`atan2` takes 2 nodes, and got 1",
            "b.compare('<', x, x)": "such as `Relation.LESS`",
            "b.select(x, x, x)": "the condition is no comparison",
            "b.add(x, b.compare(Relation.LESS, x, x))": "made a wrong node Add",
            "b.compare(Relation.LESS, x, x)": "returned a comparison, not a value",
            "b.constant(float('nan'))": "a constant has a value that is not finite",
            "b.constant([1, 2])": "a constant has 2 elements, and its axes 1",
            "b.constant(1, unit='m')": "write `parse_unit('m/s')`",
            "b.constant([1, 2], 'i')": "is not in a tuple of `msnn.extending.Axis`",
            "b.slice(x, 'i', 0, 1)": "the value is scalar, and has no axis `i`",
            "b.element(b.constant([1, 2], (Axis('i', 2),)), 'i', 2)": "2 elements, and none at 2",
            "b.slice(b.constant([1, 2], (Axis('i', 2),)), 'i', 0, 3)": "not [0, 3)",
            "b.rename(x, 'i', 'j')": "has no axis `i`",
            "GraphBuilder().constant(1)": "a node of another graph: do not keep nodes between",
        }.items()
    ),
    *(
        Fault("layer `plain_layer`", f"def expand(c, s, a): return {formula}", message)
        for formula, message in {
            "c.learned('', (), 0, 'x')": "'' is no name of a learned array",
            "c.learned('a b', (), 0, 'x')": "'a b' is no name of a learned array",
            "[c.learned('w', (), 0, 'x') for _ in 'ab'][0]": "`w` is declared twice in one call",
            "c.learned('w', (), 2, 'x', high=1)": "initial value 2 of `w` is not in -inf … 1",
            "c.learned('w', (), float('nan'), 'x')": "an initial value of `w` is not finite",
            "c.learned('w', (), 1, 'x', low=float('nan'))": "a bound of `w` is not finite",
            "c.learned('w', (), 1, 'x', low=2, high=1)": "2, which is not below `high` 1",
            "c.learned('w', ('i',), 1, 'x')": "`'i'` is not a `msnn.extending.Axis`",
            "c.learned('w', (Axis('i', 2),), [1, 2, 3], 'x')": "raised ValueError",
            "c.learned('w', (), 1, 'x', unit='m')": "write `parse_unit('m/s')`",
            "c.learned('w', (Axis('i', 0),), 1, 'x')": "raised ValueError: `w` has an empty axis",
            "c.learned('w', (Axis('i', 2), Axis('i', 2)), 1, 'x')": "`w` has an axis twice",
            "c.refuse('too small')": "is not a Diagnostic: write `error(...)`",
            "c.refuse(warning('A1', None, 'x'))": "a warning refuses nothing: write `error(...)`",
            "c.refuse(remark('A1', None, 'x'))": "a note refuses nothing: write `error(...)`",
        }.items()
    ),
    Fault(
        "layer `plain_layer`",
        "def read(c, s): return (3,)",
        "read `3`, which is a number, not a node",
    ),
    Fault("target `sheet`", "def prepare(r, e): return 1 / 0", "raised ZeroDivisionError", "check"),
    Fault("target `sheet`", "def prepare(r, e): return None", "planned nothing, and", "export"),
    Fault("target `sheet`", "def prepare(r, e): return 3", "not a ExportPlan", "export"),
    Fault("target `sheet`", "def faults(plan): return None", "not a tuple", "check"),
    Fault("target `sheet`", "def write(p, w, f): open('/no/x')", "raised FileNotFound", "export"),
    Fault("target `sheet`", "def write(p, w, f): return f", "not a tuple of paths", "export"),
    Fault("target `sheet`", "def write(p, w, f): return ('a',)", "returned a str", "export"),
    Fault(
        "target `sheet`",
        "def write(p, w, f): return (f / 'b.txt',)",
        "names b.txt, and did not write it",
        "export",
    ),
    Fault(
        "target `sheet`",
        "def write(p, w, f):\n    g = f / '..' / 'b.txt'\n    g.touch()\n    return (g,)",
        "wrote b.txt outside of its folder",
        "export",
    ),
    Fault(
        "target `sheet`",
        "def write(p, w, f): w['k'] *= 2",
        "raised ValueError: output array is read-only (faulty, line 50, in write)",
        "export",
    ),
    Fault("target `sheet`", "def write(p, w, f): w['k'] = 2", "raised TypeError", "export"),
    Fault("target `sheet`", "def write(p, w, f): w.clear()", "raised AttributeError", "export"),
    Fault(
        "target `sheet`",
        "def prepare(r, e):\n    if r.weights: r.weights['k'][...] = 3\n"
        "    return float_plan(SHEET, r, e)",
        "raised ValueError: assignment destination is read-only",
        "export",
    ),
    Fault("target `sheet`", "def load(p, w): raise KeyError('x')", "raised KeyError", "--check"),
    Fault("target `sheet`", "def load(p, w): return 3", "raised TypeError", "--check"),
)


def ended(fault: Fault, install: Install, folder: Path, *options: str) -> int:
    install("faulty", {"faulty.py": RECORD.replace("REPLACED", fault.change)}, "faulty:FEATURE")
    file = str(spec_file(folder, SPEC))
    if fault.verb in ("show", "check"):
        return run([fault.verb, file, *options])
    more = () if fault.verb == "export" else ("--check",)
    return run(["export", file, "--initial", "--out", str(folder / "out"), *more, *options])


def test_without_a_fault_it_works(install: Install, tmp_path: Path):
    for verb in ("show", "check", "export"):
        assert ended(Fault("", "", "", verb), install, tmp_path) == 0


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.change[:50])
def test_a_fault_names_the_plugin(
    fault: Fault, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert ended(fault, install, tmp_path) == 1
    said = capsys.readouterr().err
    named = f"error[E0230]: the {fault.part} of the package faulty 0.1.0 "
    assert fault.message in said.partition(named)[2].partition("\n")[0]
    assert "Traceback" not in said
    assert "of its own" not in said


@pytest.mark.parametrize(
    "fault",
    [fault for fault in FAULTS if fault.message.startswith("raised ")],
    ids=lambda fault: fault.change[:50],
)
def test_verbose_shows_the_traceback(
    fault: Fault, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert ended(fault, install, tmp_path, "--verbose") == 1
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert fault.message.partition(" ")[2].partition("(")[0].rstrip(": ") in said


def test_what_a_plugin_prints_is_no_result(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    change = "def text(problem): print('compiled'); return 'a limit'"
    assert ended(Fault("", change, "", "show"), install, tmp_path) == 0
    said = capsys.readouterr()
    assert "a limit" in said.out
    assert "compiled" not in said.out
    assert "compiled" in said.err

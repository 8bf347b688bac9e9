"""Mistakes of plug-ins are reported as theirs: the package, its version, the name and the line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from msnn.cli.application import run
from tests.extending.conftest import Install
from tests.extending.test_plugins import PLAIN, spec_file

RECORD = """
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
        "raised KeyError: 'k' (faulty, line 48, in compiler)",
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
    Fault("section `limit`", "def compiler(): pass", "raised TypeError: "),
    Fault("section `limit`", "def text(problem): return problem.size", "raised AttributeError"),
    Fault("section `limit`", "def text(problem): return None", "returned a NoneType, not a str"),
    Fault("section `limit`", "def names_used(entry): return 3", "raised TypeError"),
    Fault("layer `plain_layer`", "def read(c, s): return 3", "read a int, not a tuple of nodes"),
    Fault("layer `plain_layer`", "def expand(c, s, a): return a[1]", "raised IndexError"),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return None",
        "returned a NoneType, not a node of the builder",
    ),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return 10**6",
        "returned 1000000, which is no node of the builder",
    ),
    Fault(
        "layer `plain_layer`",
        "def expand(c, s, a): return c.builder.sum(a[0], 'gone')",
        "made a wrong node Sum: not the sum over `gone`",
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
    Fault("function `twice`", "def twice(b, x): return b.add(x, 99)", "raised IndexError"),
    Fault("function `twice`", "def twice(builder): return 0", "raised TypeError"),
    Fault("function `twice`", "def twice(b, x): return 'x'", "returned a str, not a node"),
    Fault("function `twice`", "def twice(b, x): return -1", "returned -1, which is no node"),
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


def test_verbose_shows_the_traceback(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert ended(FAULTS[0], install, tmp_path, "--verbose") == 1
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "KeyError: 'k'" in said

"""Functions in Python become formulas, or are refused with their line."""

from __future__ import annotations

import json

import pytest

from spec_schema.diagnostics.diagnostic import SpecError
from tests.features.nnodely.saved_model import imported_text, with_function


def _formula(body: str) -> str:
    spec = imported_text(with_function(f"def f(x):\n{body}")).spec
    return spec["functions"]["f"]["expr"] if "functions" in spec else spec["outputs"]["out"]


@pytest.mark.parametrize(
    ("body", "formula"),
    [
        ("    return torch.sin(x) * 2\n", "sin(x) * 2"),
        ("    return -x ** 2\n", "-x ** 2"),
        ("    return (-x) ** 2\n", "(-x) ** 2"),
        ("    return x - (x - 1)\n", "x - (x - 1)"),
        ("    return x / (x * 2)\n", "x / (x * 2)"),
        ("    return 2 ** x\n", "pow(2, x)"),
        ("    y = x * 2\n    y += 1\n    y *= x\n    return y\n", "(x * 2 + 1) * x"),
        ("    y = x.clone()\n    y += 1\n    return y * x\n", "(x + 1) * x"),
        ("    return (x > 0) + (x > 1)\n", "max(where(x > 0, 1, 0), where(x > 1, 1, 0))"),
        (
            "    return (x > 0).float() + (x > 1).float()\n",
            "where(x > 0, 1, 0) + where(x > 1, 1, 0)",
        ),
        ("    'Says what it is.'\n    return x.abs() + 1\n", "abs(x) + 1"),
        ("    return torch.where(x > 0, x, -x)\n", "where(x > 0, x, -x)"),
        ("    return x * (x > 0)\n", "x * where(x > 0, 1, 0)"),
        ("    return torch.clamp(x, max=1.0)\n", "min(x, 1)"),
        ("    for i in range(1, 3):\n        x = x + i\n    return x\n", "x + 1 + 2"),
        ("    return torch.nn.functional.softplus(x) * torch.pi\n", "softplus(x) * pi"),
        ("    return x * math.sqrt(4)\n", "x * 2"),
        ("    if true:\n        return x + 1\n    return x\n", "x + 1"),
        ("    import torch\n    return torch.sin(x)\n", "sin(x)"),
        (
            "    import torch.nn.functional as F, math as m\n    return F.relu(x) * m.pi\n",
            "relu(x) * pi",
        ),
        ("    from torch import sin as s, pi\n    return s(x) * pi\n", "sin(x) * pi"),
        ("    from torch.nn import functional\n    return functional.relu(x)\n", "relu(x)"),
        ("    i = 5\n    y = [x * i for i in (1, 2)]\n    return y[1] + i\n", "x * 2 + 5"),
        ("    y = [x for x in range(3)]\n    return x * y[2]\n", "x * 2"),
        ("    return torch.cat((x, x), dim=2).sum(dim=2, keepdim=true)\n", "x + x"),
        ("    return torch.stack([x, x * 2])[1]\n", "x * 2"),
        ("    return (x.unsqueeze(-1) @ torch.tensor([[2.0]])).squeeze(-1)\n", "x * 2"),
        ("    return torch.einsum('bwi,io->bwo', x, torch.eye(1) * 2)\n", "x * 2"),
        # exp(x) / (exp(x) + exp(2 x)) is NaN from x = 355 on
        (
            "    return torch.softmax(torch.cat((x, x * 2), dim=2), dim=2)[:, :, 1:]\n",
            "1 / (exp(x - x * 2) + exp(x * 2 - x * 2))",
        ),
        ("    return x.expand(-1, -1, 3).mean(dim=-1, keepdim=True)\n", "(x + x + x) / 3"),
        # names of a comprehension end with it
        ("    i = 5\n    y = [x + i for i in range(2)]\n    return y[0] * i\n", "x * 5"),
        ("    return sum([x, x * 2], 1.0)\n", "1 + x + x * 2"),
        (
            "    return torch.log2(x) + torch.log10(x)\n",
            "log(x) / 0.6931471805599453 + log(x) / 2.302585092994046",
        ),
        ("    return torch.norm(x, 2, dim=-1, keepdim=True)\n", "sqrt(x * x)"),
        ("    return torch.norm(x, p='fro', dim=-1, keepdim=True)\n", "sqrt(x * x)"),
    ],
)
def test_a_function_is_a_formula(body: str, formula: str) -> None:
    assert _formula(body) == formula


@pytest.mark.parametrize(
    ("code", "line", "reason"),
    [
        ("def f(x):\n    return os.system('id')\n", 2, "the name `os`"),
        ("def f(x):\n    import os\n    return x\n", 2, "an import of `os`"),
        ("def f(x):\n    from os import path\n    return x\n", 2, "an import of `os`"),
        ("def f(x):\n    from . import torch\n    return x\n", 2, "an import of `.`"),
        ("def f(x):\n    from .torch import sin\n    return x\n", 2, "an import of `.torch`"),
        ("def f(x):\n    from torch import *\n    return x\n", 2, "an import of `torch.*`"),
        ("def f(x):\n    import torch as t\n    return t.load('x')\n", 3, "of `torch.load`"),
        ("def f(x):\n    return __import__('os')\n", 2, "the name `__import__`"),
        ("def f(x):\n    return x.__class__\n", 2, "the member `__class__`"),
        ("def f(x):\n    return torch.load('x')\n", 2, "the call of `torch.load`"),
        ("def f(x):\n    return torch.randn(1)\n", 2, "the call of `torch.randn`"),
        ("def f(x):\n    return torch.os.getcwd()\n", 2, "the call of `torch.os.getcwd`"),
        ("def f(x):\n    if x > 0:\n        return x\n    return -x\n", 2, "a choice by values"),
        ("def f(x):\n    while x:\n        pass\n", 2, "a statement `while`"),
        ("def f(x):\n    return (lambda y: y)(x)\n", 2, "an expression `lambda`"),
        ("def f(x):\n    y = [1] * 10**9\n    return x\n", 2, "arithmetic with a list"),
        ("def f(x):\n    return 9**9**9 * x\n", 2, "operands that do not fit"),
        ("def f(x):\n    y = 10**15\n    return x * (y * y)\n", 3, "too large"),
        ("def f(x):\n    return torch.zeros(10**9)\n", 2, "more than 10,000 elements"),
        ("def f(x):\n    for i in range(10**9):\n        x = x + 1\n    return x\n", 2, "too long"),
        ("def f(x):\n    return x.sum()\n", 1, "it returns a number"),
        ("def f(x):\n    pass\n", 1, "it returns nothing"),
        ("def f(x, y):\n    return x\n", 1, "takes 2 arguments and gets 1"),
        ("def f(*x):\n    return x\n", 1, "defaults or stars"),
        ("@torch.jit.script\ndef f(x):\n    return x\n", 2, "it has a decorator"),
        ("def f(x):\n  return (x\n", 2, "it is not Python"),
        ("def g(x):\n    return x\n", 1, "it is called `g`, not `f`"),
        ("import os\ndef f(x):\n    return x\n", 1, "more than one function"),
        ("def f(x):\n    return " + "-" * 3000 + "x\n", 1, "nested too deep"),
        ("def f(x):\n    a, b = [x]\n    return a\n", 2, "names do not fit"),
        ("def f(x):\n    for a, b in [[x]]:\n        x = a\n    return x\n", 2, "names do not fit"),
        ("def f(x):\n    x[0] = 1\n    return x\n", 2, "names do not fit"),
        ("def f(x):\n    y = x\n    y += 1\n    return x\n", 3, "in place to what others share"),
        ("def f(x):\n    y = x[:, :]\n    y *= 2\n    return x\n", 3, "what others share"),
        ("def f(x):\n    x += 1\n    return x\n", 2, "in place to what others share"),
        ("def f(x):\n    return x.to(torch.int64) / 2\n", 2, "`to` to `torch.int64`"),
        ("def f(x):\n    return torch.tensor([0.5], dtype=torch.long) + x\n", 2, "torch.long"),
        ("def f(x):\n    return x / torch.norm(x, 1)\n", 2, "a `norm` that is not"),
        ("def f(x):\n    return x / torch.norm(x, p=3, dim=2)\n", 2, "a `norm` that is not"),
        ("def f(x):\n    return sum([x, x], start=2.0)\n", 2, "the call of `builtins.sum`"),
        ("def f(x):\n    return x * max(1, 2, key=x)\n", 2, "the call of `builtins.max`"),
        ("def f(x):\n    return x[:, 5:]\n", 1, "it returns no elements"),
        ("def f(x):\n    return torch.softmax(x, dim=0)\n", 1, "depends on the other samples"),
        ("def f(x):\n    return x * x.shape[0]\n", 1, "depends on the other samples"),
        ("def f(x):\n    return x - x.mean(0, True)\n", 1, "depends on the other samples"),
        ("def f(x):\n    return x - x[0]\n", 1, "depends on the other samples"),
        ("def f(x):\n    return\n", 2, "a statement `return`"),
        ("def f(x):\n    return x[5, 5, 5]\n", 2, "operands that do not fit"),
        ("def f(x):\n    return torch.cat((x, x), dim=7)\n", 2, "operands that do not fit"),
    ],
)
def test_what_is_not_translated_is_refused_with_its_line(code: str, line: int, reason: str) -> None:
    with pytest.raises(SpecError) as caught:
        imported_text(with_function(code))
    found = caught.value.diagnostics[0]
    assert found.code == "E1313"
    assert reason in found.message
    shown = code.splitlines()[line - 1].strip()
    assert found.notes == (f"the line is `{shown[:100]}`",)


def test_the_place_is_the_line_within_the_text_of_the_file() -> None:
    model = with_function("def f(x):\n    y = x\n    return eval(y)\n")
    with pytest.raises(SpecError) as caught:
        imported_text(model)
    span = caught.value.diagnostics[0].span
    assert span is not None
    line = json.dumps(model, indent=1).splitlines()[span.line - 1]
    assert line[span.column - 1 : span.end_column - 1] == "return eval(y)"


def test_work_without_end_is_cut_short() -> None:
    body = "".join("    x = torch.cat((x, x), dim=2)\n" for _ in range(40))
    with pytest.raises(SpecError) as caught:
        imported_text(with_function(f"def f(x):\n{body}    return x\n"))
    assert "more than 10,000 elements" in caught.value.diagnostics[0].message

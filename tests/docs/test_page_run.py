"""What runs pages finds what is wrong with them: each page here has one mistake, or none."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.blocks import blocks_of, indented_code, unseen_code
from tests.docs.page_run import PageRun

FENCE = "```"
CHANGED = """\
~~~c title="a.txt"
one
two
~~~

~~~diff title="a.txt"
 one
-two
+three
~~~

~~~sh
cat a.txt
~~~

~~~text
one
three
~~~
"""


def _faults(folder: Path, text: str) -> list[str]:
    page = folder / "page.md"
    page.write_text(text.replace("~~~", FENCE), encoding="utf-8")
    clean, home = folder / "clean", folder / "home"
    clean.mkdir()
    home.mkdir()
    run = PageRun(page, clean, home)
    for block in blocks_of(page):
        run.run(block)
    return run.faults


@pytest.mark.parametrize(
    "text",
    [
        "~~~sh\necho 1.01 s\necho more\n~~~\n\n~~~text\n1.00 s\n…\n~~~\n",
        CHANGED,
        "<!-- before: echo hidden > a.txt -->\n~~~sh\ncat a.txt\n~~~\n\n~~~text\nhidden\n~~~\n",
        "<!-- exits: 3 -->\n~~~sh\nfalse\nexit 3\n~~~\n",
        "<!-- not run: it takes a board -->\n~~~sh\nmsnn verify DIR --board gdb:host:1\n~~~\n",
    ],
)
def test_a_right_page_has_no_faults(text: str, tmp_path: Path):
    assert _faults(tmp_path, text) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("~~~sh\nfalse\necho on\n~~~\n", "exit code 1"),
        ("~~~sh\necho 1.05 s\n~~~\n\n~~~text\n1.00 s\n~~~\n", "shows '1.00 s', printed was"),
        ("~~~sh\necho one\n~~~\n\n~~~text\ntwo\n~~~\n", "is not printed: 'two'"),
        ("~~~sh\necho one\necho two\n~~~\n\n~~~text\none\n~~~\n", "leaves out what is printed"),
        ("~~~text\nof nothing\n~~~\n", "neither runs nor says by a comment"),
        (
            "~~~sh\necho\n~~~\n<!-- not run: a board is it -->\n~~~sh\nls\n~~~\n~~~text\n\n~~~\n",
            "neither runs nor says by a comment",
        ),
        ("~~~lua\nprint(1)\n~~~\n", "neither runs nor says by a comment"),
        ("~~~yaml\ninputs: {u: V}\n~~~\n", "neither runs nor says by a comment"),
        ("<!-- not run: so -->\n~~~sh\necho\n~~~\n", "says no reason"),
        (
            "<!-- not run: it takes a board -->\n~~~sh\nmsnn verify DIR --bord x\n~~~\n",
            "msnn verify has no option --bord",
        ),
        ("<!-- not run: it takes too long -->\n~~~sh\nmsnn trian a\n~~~\n", "has no verb trian"),
        ("<!-- run by: tests/docs/nobody.py -->\n~~~sh\necho\n~~~\n", "is no test of this page"),
        (
            '~~~c title="a.txt"\none\n~~~\n\n~~~diff title="a.txt"\n-two\n~~~\n',
            "does not have once",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place(text: str, said: str, tmp_path: Path):
    (fault,) = _faults(tmp_path, text)
    assert fault.startswith("page.md:")
    assert said in fault


def test_code_without_a_fence_is_found_outside_of_lists(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("Run\n\n    msnn check\n\n- an item\n\n    goes on\n", encoding="utf-8")
    assert indented_code(page) == [3]


@pytest.mark.parametrize(
    "code",
    [
        "{tildes}sh\nls\n{tildes}",
        "> ```sh\n> ls\n> ```",
        "1. ```sh\n   ls\n   ```",
        "<pre>ls</pre>",
    ],
)
def test_code_that_would_not_be_run_is_found(code: str, tmp_path: Path):
    page = tmp_path / "page.md"
    code = code.format(tildes="~" * 3)
    page.write_text(f"```sh\nls\n```\n\n{code}\n", encoding="utf-8")
    assert unseen_code(page)[0] == 5


def test_a_test_of_another_page_of_the_folder_is_no_test_of_this_one(tmp_path: Path):
    folder = tmp_path / "docs"
    folder.mkdir()
    (fault,) = _faults(folder, "<!-- run by: tests/docs/test_mpc_page.py -->\n~~~sh\necho\n~~~\n")
    assert "is no test of this page" in fault

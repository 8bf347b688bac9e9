"""Which line of a compiler is shown: the one that says what is wrong."""

from __future__ import annotations

import pytest

from backends.files.c_compiler import complaints

WHAT_TO_SHOW = "> "
SAID = {
    "a linker, which names no error": """
> /usr/bin/ld: cannot find -lvendor: No such file or directory
collect2: error: ld returned 1 exit status
""",
    "a name without a definition": """
/usr/bin/ld: /tmp/m.o: warning: relocation in read-only section `.text'
/usr/bin/ld: /tmp/m.o: in function `step':
> m.c:(.text+0x9): undefined reference to `vendor_step'
collect2: error: ld returned 1 exit status
""",
    "another linker": """
> ld.lld: error: unable to find library -lvendor
clang: error: linker command failed with exit code 1 (use -v to see invocation)
""",
    "a full disk": """
> cc1: fatal error: closing /tmp/m.s: No space left on device
compilation terminated.
""",
    "a mistake after a warning": """
m.c: In function 'step':
m.c:2:9: warning: unused variable 'error' [-Wunused-variable]
    2 |     int error;
> m.c:3:5: error: expected expression before '}' token
1 error generated.
""",
}


@pytest.mark.parametrize("case", SAID)
def test_the_first_line_says_what_is_wrong(case: str) -> None:
    lines = SAID[case].splitlines()
    (wanted,) = (line.removeprefix(WHAT_TO_SHOW) for line in lines if line[:2] == WHAT_TO_SHOW)
    output = "\n".join(line.removeprefix(WHAT_TO_SHOW) for line in lines)
    assert complaints(output)[0] == wanted


@pytest.mark.parametrize("output", ["\n \n", "collect2: error: ld returned 1 exit status\n"])
def test_nothing_but_that_it_failed_is_no_complaint(output: str) -> None:
    assert complaints(output) == []

"""Runs commands of msnn in one process that cannot import torch, casadi, onnx or an extra.

Started with `python -I -S session.py FOLDER...`: the folders are all that Python looks in. The
names that cannot be imported, then commands come as JSON lists on standard input, a line each; what
each said goes as JSON to standard output.
"""

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout

OURS = {"spec_schema", "compiler", "backends", "templates"}


class Hidden:
    """Refuses packages as if they were not installed."""

    def __init__(self, names: set[str]) -> None:
        self.names = names

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name.partition(".")[0] in self.names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def main() -> None:
    sys.path[:0] = sys.argv[1:]
    sys.dont_write_bytecode = True
    sys.meta_path.insert(0, Hidden(set(json.loads(sys.stdin.readline()))))
    from msnn.cli.application import run

    said: list[dict[str, int | str]] = []
    for line in sys.stdin:
        out, err = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            code = int(run(json.loads(line)))
        said.append({"code": code, "out": out.getvalue(), "err": err.getvalue()})
    loaded = sorted({name.partition(".")[0] for name in sys.modules})
    json.dump({"said": said, "loaded": loaded}, sys.stdout)


if __name__ == "__main__":
    main()

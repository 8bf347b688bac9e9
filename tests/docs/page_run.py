"""Runs the blocks of a page one after the other in a folder, as somebody does who reads it.

| block | what happens |
|---|---|
| with a title or a `file:` | is written; a spec (`msnn: 1`) is checked too |
| `diff` with a title | changes that file: finds its lines with ` ` and `-`; `@@` is between parts |
| `sh` | runs, each line with the exit code 0; with `exits: N` the last line ends with N |
| `python` without a title | runs |
| `text` | is what the block before has printed |
| `yaml` with `keys of: FILE` | FILE with these keys in place of its own is a spec without errors |
| any, `run by: FILE` | is left to that test, which names the page |
| any, `not run: WHY` | is read: shell by its grammar and the options of msnn, TOML by a parser |

`before:` and `after:` are commands that readers are not shown; `$ROOT` is the repository. Packages
that they put into the folder `site-packages` are installed for the commands of the page.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from backends.native.kernel_cache import cache_folder
from tests.docs.blocks import Block
from tests.docs.printed import compared
from tests.docs.shell_grammar import wrong_in_shell

ROOT = Path(__file__).resolve().parents[2]
INSTALLED = "site-packages"
"""The folder, in that of a page, in which its hidden commands install packages."""


@dataclass
class PageRun:
    """A page in a folder: what its commands print, and what of its blocks is not so."""

    page: Path
    folder: Path
    home: Path
    commands: Path | None = None
    """A folder with commands that come before those of the environment."""
    faults: list[str] = field(default_factory=list[str])
    printed: dict[tuple[int, int], str] = field(default_factory=dict[tuple[int, int], str])
    """What a `text` block has to be, where it is something else."""
    _said: str | None = None

    def run(self, block: Block) -> None:
        """Does what a block is for; what is wrong goes to `faults`."""
        before = self._shell(block.marks.get("before", ""))
        if before.returncode:
            self._fault(block, f"before it: {before.stderr}")
        self._do(block)
        after = self._shell(block.marks.get("after", ""))
        if after.returncode:
            self._fault(block, f"after it: {after.stdout}{after.stderr}")

    def _do(self, block: Block) -> None:
        marks, language = block.marks, block.language
        said, self._said = self._said, None  # a `text` block is of the block before it, or of none
        if "run by" in marks:
            self._left(block, marks["run by"])
        elif language == "diff" and block.file is not None:
            self._change(block, self.folder / block.file)
        elif block.file is not None:
            (self.folder / block.file).write_text(block.text, encoding="utf-8")
            if block.is_spec:
                self._expect(block, self._shell(f"msnn check {block.file}"), 0)
        elif "not run" in marks:
            self._read(block, marks["not run"])
        elif "keys of" in marks:
            self._keys(block, marks["keys of"])
        elif language == "sh":
            self._said = self._run(block)
        elif language == "python":
            self._said = self._expect(block, self._process([sys.executable, "-c", block.text]), 0)
        elif language == "text" and said is not None:
            self._compare(block, said)
        else:
            self._fault(block, "neither runs nor says by a comment what it is: tests/docs/page_run")

    def _run(self, block: Block) -> str:
        """Every line has to end well, unless the page says how the last one ends."""
        if "exits" in block.marks:
            done = self._process(["bash", "-c", block.text])
            return self._expect(block, done, int(block.marks["exits"]))
        return self._expect(block, self._shell(block.text), 0)

    def _change(self, block: Block, file: Path) -> None:
        text = file.read_text(encoding="utf-8")
        for part in block.text.split("@@\n"):
            lines = part.splitlines(keepends=True)
            old = "".join(line[1:] for line in lines if not line.startswith("+"))
            if text.count(old) != 1:
                self._fault(block, f"{file.name} does not have once:\n{old}")
                return
            new = "".join(line[1:] for line in lines if not line.startswith("-"))
            text = text.replace(old, new)
        file.write_text(text, encoding="utf-8")
        if file.suffix == ".yaml":
            self._expect(block, self._shell(f"msnn check {file.name}"), 0)

    def _keys(self, block: Block, host: str) -> None:
        """The host's spec with the sections of the block in place of its own."""
        known = self.folder / host
        file = known if known.is_file() else ROOT / host
        spec = yaml.safe_load(file.read_text(encoding="utf-8"))
        spec |= yaml.safe_load(block.text)
        merged = self.folder / f"keys_at_{block.line}.msnn.yaml"
        merged.write_text(yaml.safe_dump(spec, sort_keys=False), encoding="utf-8")
        self._expect(block, self._shell(f"msnn check {merged.name}"), 0)

    def _left(self, block: Block, by: str) -> None:
        test = ROOT / by
        is_of_example = self.page.name == "README.md" and self.page.parent != ROOT
        named = self.page.parent.name if is_of_example else self.page.name
        if not test.is_file() or named not in test.read_text(encoding="utf-8"):
            self._fault(block, f"{by} is no test of this page")

    def _read(self, block: Block, why: str) -> None:
        wrong = "" if len(why.split()) > 2 else "says no reason for which it is not run"
        if block.language == "sh":
            wrong = wrong or wrong_in_shell(block.text)
        elif block.language == "toml":
            tomllib.loads(block.text)
        if wrong:
            self._fault(block, wrong)

    def _compare(self, block: Block, said: str) -> None:
        wrong, now = compared(block.text, said)
        if wrong:
            self._fault(block, wrong)
        self.printed[block.span] = now

    def _shell(self, commands: str) -> subprocess.CompletedProcess[str]:
        return self._process(["bash", "-e", "-o", "pipefail", "-c", commands])

    def _process(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        folders = [*filter(None, [self.commands]), Path(sys.executable).parent, os.environ["PATH"]]
        environment = {
            **os.environ,
            "PATH": os.pathsep.join(map(str, folders)),
            "PYTHONPATH": os.pathsep.join((str(ROOT), str(self.folder / INSTALLED))),
            "ROOT": str(ROOT),
            "HOME": str(self.home),
            "MSNN_CACHE": str(cache_folder()),  # what one page has compiled others load
        }
        return subprocess.run(
            words, cwd=self.folder, env=environment, capture_output=True, text=True, check=False
        )

    def _expect(self, block: Block, done: subprocess.CompletedProcess[str], code: int) -> str:
        if done.returncode != code:
            self._fault(block, f"exit code {done.returncode}:\n{done.stdout}{done.stderr}")
        return done.stdout + done.stderr

    def _fault(self, block: Block, what: str) -> None:
        self.faults.append(f"{self.page.name}:{block.line}: {what}")

"""Make the data, learn the friction, compare it with its baselines, export and use it.

Everything is done by the commands that a user types; each is shown before it runs.
"""

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ARM, COMPENSATOR = "z1_friction.msnn.yaml", "compensator.msnn.yaml"


def main() -> int:
    """Run the commands in the example's folder; ends with the exit code of the first that fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", action="append", default=[], help="passed on to `msnn train`")
    settings = [word for value in parser.parse_args().set for word in ("--set", value)]
    run("generate_data.py")
    run("-m", "msnn", "train", ARM, *settings)
    run("-m", "msnn", "validate", ARM)
    run("evaluate.py")
    run("control.py")
    run("-m", "msnn", "export", COMPENSATOR, "--to", "c", "--check")
    run("-m", "msnn", "verify", "build/export/c")
    return 0


def run(*arguments: str) -> None:
    """Show a command and run it; what it writes goes to the terminal."""
    shown = arguments[1:] if arguments[0] == "-m" else ("python", *arguments)
    print(f"\n$ {' '.join(shown)}", flush=True)
    code = subprocess.run([sys.executable, *arguments], cwd=HERE, check=False).returncode
    if code not in (0, 3):  # 3: a limit is broken, and the table has said so
        raise SystemExit(code)


if __name__ == "__main__":
    raise SystemExit(main())

"""`python -m msnn`: the command line, which imports no module of the working folder."""

import sys
from pathlib import Path

from msnn.project.package_names import HOME

# `-m` lets Python look in the working folder first, where a user's `ziglang.py` may lie; only a
# checkout that is not installed is found there itself
if not sys.flags.safe_path and Path(sys.path[0]).resolve() != HOME:
    del sys.path[0]

from msnn.cli.main import main

main()

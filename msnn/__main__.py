"""`python -m msnn`: the command line."""

from msnn.cli.main import main

main()

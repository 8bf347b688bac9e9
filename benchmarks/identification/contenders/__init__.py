"""What each toolbox does with one system, a process each: `python NAME.py SYSTEM DATA`."""

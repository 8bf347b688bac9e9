"""Programs that identify a system with one toolbox each: `python NAME.py SYSTEM DATA`."""

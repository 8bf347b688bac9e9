"""Replays the golden vectors on a physical board, with a debugger or a serial line."""

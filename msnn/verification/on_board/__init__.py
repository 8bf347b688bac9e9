"""Replays the golden vectors on a real board, through a debugger or a serial line."""

"""Builds exported C for the host and for boards, with the harness around it."""

"""Runs compiled file readers in a separate process, which a malformed file may crash."""

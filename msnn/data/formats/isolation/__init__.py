"""Reads files with compiled readers in a process of its own, which a broken file may end."""

"""Passes that keep derivatives finite for libraries that take them by themselves."""

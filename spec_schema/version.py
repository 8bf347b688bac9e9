"""The version of msnn, written into everything that it makes; pyproject.toml reads it from here."""

__version__ = "0.1.0"

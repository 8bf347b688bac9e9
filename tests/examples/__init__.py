"""Tests of what the examples ship beside their specs."""

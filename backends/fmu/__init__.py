"""Writes Functional Mock-up Units: generated C behind the functions of FMI 2.0 and 3.0."""

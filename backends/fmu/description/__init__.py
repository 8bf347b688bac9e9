"""Describes a unit to FMI: its variables, their units, and the XML of both versions."""

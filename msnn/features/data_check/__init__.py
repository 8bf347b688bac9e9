"""Checks measured data before modelling: errors in the data, and their information content."""

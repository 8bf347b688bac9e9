"""Runs the judge along a record that an export meets too."""

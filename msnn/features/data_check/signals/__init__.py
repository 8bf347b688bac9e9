"""Finds what one column of a log shows by itself: its rows, its values, its faults."""

"""Writes the C self-test of a controller, with recorded (golden) solves that it must reproduce."""

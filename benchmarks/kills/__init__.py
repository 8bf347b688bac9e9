"""Kills trainings and exports, and checks the files that remain."""

"""Kills trainings and exports, and looks at what is left."""

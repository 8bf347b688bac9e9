"""Starts a project, and looks at the installation."""

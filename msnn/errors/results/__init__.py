"""Diagnostics of what is measured, compared and reported of trained models."""

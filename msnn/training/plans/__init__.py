"""Decides before training what each stage does."""

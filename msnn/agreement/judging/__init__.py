"""Runs the reference interpreter on the inputs that an export is compared on."""

"""Runs what was exported on this machine: C that was built, units, rollouts in them."""

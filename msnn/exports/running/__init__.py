"""Runs exports on this machine: compiled C, FMUs, rollouts in them."""

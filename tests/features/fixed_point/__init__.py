"""Tests of exports in fixed point."""

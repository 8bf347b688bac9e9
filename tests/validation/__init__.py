"""Tests of measuring and judging trained models."""

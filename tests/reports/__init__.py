"""Tests of reports: pages of runs, diagrams, pictures."""

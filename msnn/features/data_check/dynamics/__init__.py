"""Identifies the system from several columns: responses, delays, time constants, excitation."""

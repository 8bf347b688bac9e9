"""Finds what columns of a log show together: responses, delays, time constants, excitation."""

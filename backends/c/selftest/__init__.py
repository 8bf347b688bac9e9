"""Writes the self-test of exported C and the golden vectors that it runs."""

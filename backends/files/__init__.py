"""Writes files whole or not at all, and finds the compiler that reads them."""

"""Reads and writes programs as versioned JSON; files are checked as untrusted input."""

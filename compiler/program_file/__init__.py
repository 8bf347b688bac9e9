"""Reads and writes programs as versioned JSON, without trust."""

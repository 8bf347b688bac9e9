"""Proves exported C: built strictly, run on the host and in QEMU, analysed, fuzzed, reported."""

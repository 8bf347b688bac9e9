"""The self-test of fixed-point C, and the test vectors of its host program."""

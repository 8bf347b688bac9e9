"""The self-test of C in fixed point, and the vectors of its test program."""

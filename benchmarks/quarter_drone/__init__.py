"""Models of a real drone arm, by the command line, beside published figures."""

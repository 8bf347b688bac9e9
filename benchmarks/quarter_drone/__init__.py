"""Models a real drone arm by the command line, and compares the errors with published ones."""

"""Units and self-tests on machines other than this one: by Wine, by QEMU."""

"""How many changes of generated C its own test program sees."""

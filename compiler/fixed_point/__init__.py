"""Fixed point: a program in integers only, its interpreter, and how far it is from the reals."""

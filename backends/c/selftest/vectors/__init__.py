"""Makes golden vectors, and checks the results of their steps in NumPy."""

"""The scalar functions, one family a file, each written once for every backend."""

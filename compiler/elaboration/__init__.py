"""Makes a program of a linked spec: every entry is lowered once for each way it is used."""

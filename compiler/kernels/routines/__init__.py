"""The scalar functions as traced routines, one family per file, each written once for all
backends.
"""

"""Proves exported C by abstract interpretation."""

"""Holds facts that programs tell training, and values that training gives to its graphs."""

"""Defines the results of the functions, with tables, frames and plots."""

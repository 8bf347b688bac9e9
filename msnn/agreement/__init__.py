"""Runs exported files against the numpy interpreter: do they compute the same model?"""

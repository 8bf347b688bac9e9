"""Reads measured data: files become recordings, recordings become episodes, episodes have start
rows.
"""

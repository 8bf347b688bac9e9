"""The reference interpreter: runs programs with numpy and so defines their meaning for all
backends.
"""

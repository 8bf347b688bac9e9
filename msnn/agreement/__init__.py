"""Runs exported files against the numpy judge: do they compute what the model means?"""

"""Passes: plain functions from Program to Program, one file each, verified before and after."""

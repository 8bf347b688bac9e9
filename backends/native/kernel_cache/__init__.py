"""Caches built kernels: chooses the folder, detects damaged files, removes old kernels."""

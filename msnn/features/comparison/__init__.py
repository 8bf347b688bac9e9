"""Compares models: trains several, measures them on rows held out, and what their C costs."""

"""Recognises relations that stand together for one thing of the language."""

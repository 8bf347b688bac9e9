"""C in fixed point: `export: {c: {dtype: q15}}` and `q31`. See README.md.

A word is an integer of 16 or 32 bits that stores a value: value = word · 2^−fraction.
"""

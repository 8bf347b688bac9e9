"""C in fixed point: `export: {c: {dtype: q15}}` and `q31`. See README.md."""

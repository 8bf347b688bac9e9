"""The keys of `mpc`, `estimator` and `export: {mpc: …}`."""

"""Steps a model from Python, one sample at a time, for simulators and control loops."""

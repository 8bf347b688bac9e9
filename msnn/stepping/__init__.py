"""Steps a model from Python, a sample at a time: what simulators and control loops need."""

"""What msnn does without torch, casadi and onnx, in the checkout and installed."""

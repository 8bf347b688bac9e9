"""Turns a Program into a torch module, a CasADi function, an ONNX model or C sources."""

"""Trained networks for other programs: safetensors and ONNX."""

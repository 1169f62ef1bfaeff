"""What is measured: pure functions on arrays, and thin torchmetrics shells that merge across processes."""

"""A detector on files: frame streams, batches, writers."""

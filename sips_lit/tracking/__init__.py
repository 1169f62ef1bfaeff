"""Following points through video: KLT."""

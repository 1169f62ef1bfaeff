"""One published data set a file, each with its ``SPEC``."""

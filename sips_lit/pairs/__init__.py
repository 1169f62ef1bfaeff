"""Which two frames: overlap index, sampling, pair lists, indexing of many recordings."""

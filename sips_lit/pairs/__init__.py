"""Which two frames: overlap index, sampling, pair lists, shards."""

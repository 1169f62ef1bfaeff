"""Following points through video: KLT, the overlap index, and the frame pairs drawn from it."""

"""Data sets as downloaded: which one a folder holds, whether it is whole, what its motion is like, and where to get it."""

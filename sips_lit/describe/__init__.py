"""Descriptors of given points."""

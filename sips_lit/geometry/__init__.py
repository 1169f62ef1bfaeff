"""Geometry on arrays: homographies, projection between views."""

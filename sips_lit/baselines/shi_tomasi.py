"""Shi-Tomasi corners, "good features to track" (Shi and Tomasi 1994)."""

from sips_lit.baselines.corners import Corners


class ShiTomasi(Corners):
    """Corners by the smaller eigenvalue, no two nearer than ``min_distance`` px."""

    name = "Shi-Tomasi"

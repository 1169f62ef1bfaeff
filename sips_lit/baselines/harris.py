"""Harris corners (Harris and Stephens 1988)."""

from sips_lit.baselines.corners import Corners


class Harris(Corners):
    """Corners by Harris' measure (k = 0.04), no two nearer than ``min_distance`` px."""

    name = "Harris"
    harris = True

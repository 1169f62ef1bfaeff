"""Succinct interest points: the fewest points that still give k inlier correspondences."""

"""Matches that know nothing of the geometry."""

import cv2
import numpy as np


def sift_matches(image0: np.ndarray, image1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (M, 2) of both images: mutual nearest neighbours that pass the ratio test."""
    sift = cv2.SIFT_create(2000)
    (points0, descriptors0), (points1, descriptors1) = (sift.detectAndCompute(i, None) for i in (image0, image1))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    forth = [a for a, b in matcher.knnMatch(descriptors0, descriptors1, 2) if a.distance < 0.75 * b.distance]
    back = {m.queryIdx: m.trainIdx for m in matcher.match(descriptors1, descriptors0)}
    mutual = [m for m in forth if back[m.trainIdx] == m.queryIdx]
    return np.array([points0[m.queryIdx].pt for m in mutual]), np.array([points1[m.trainIdx].pt for m in mutual])

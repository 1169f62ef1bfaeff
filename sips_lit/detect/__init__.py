"""From an image to points: score network, pyramid, non-maximum suppression, sub-pixel fit, selection, detector."""

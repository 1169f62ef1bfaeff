"""Points as other programs take them: hloc, COLMAP, OpenCV, kornia, vismatch."""

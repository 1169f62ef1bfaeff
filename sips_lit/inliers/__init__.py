"""Which matches of a pair are inliers, and why not: the truth that labels training and counts in evaluation."""

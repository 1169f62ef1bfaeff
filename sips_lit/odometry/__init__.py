"""Visual odometry from n points a frame: what a budget of points is worth on a whole trajectory."""

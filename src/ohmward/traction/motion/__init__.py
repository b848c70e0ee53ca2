"""One sample of the sensors of a robot, for every estimator of its motion, and its limits and gaps."""

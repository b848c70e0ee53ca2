"""Odometry: pose and twist of a robot in the plane, with covariances that grow as the errors do."""

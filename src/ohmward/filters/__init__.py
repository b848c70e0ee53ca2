"""Kalman filters on any model; they know no domain."""

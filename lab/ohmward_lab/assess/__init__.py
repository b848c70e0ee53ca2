"""Limits of the methods: which estimator holds on which chemistry, with which sensor; see docs/limits.md."""

#: Default of the largest RMSE of a recommended method: 8 points of charge, 8 cm/s.
LARGEST_RMSE = 0.08

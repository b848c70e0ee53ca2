"""Limits of the methods: which estimator holds on which chemistry, with which sensor; see docs/limits.md."""

#: Largest RMSE of a method that is recommended, unless said otherwise: 8 points of charge, 8 cm/s.
LARGEST_RMSE = 0.08

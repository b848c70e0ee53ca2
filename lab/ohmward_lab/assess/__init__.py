"""Limits of the methods: which estimator holds on which chemistry, with which sensor; see docs/limits.md."""

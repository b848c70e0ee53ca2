"""The laboratory of ohmward: what simulates, assesses and reproduces, and methods that only studies use.

It imports ohmward. Nothing in ohmward imports it; a command, a simulated source of `ohmward run` and an estimator that
reproduces a publication load it by name.
"""

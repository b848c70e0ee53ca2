"""Estimators of the state of charge: coulomb counting, rest OCV, Kalman filters on the Thevenin and the RC model."""

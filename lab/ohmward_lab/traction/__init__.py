"""Observers, laws and controllers of a robot that only studies use."""

"""Observers, laws and controllers for a robot that only studies use."""

"""Simulated robots for the process on board."""

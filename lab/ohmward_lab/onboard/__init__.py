"""Simulated robots for the on-board process."""

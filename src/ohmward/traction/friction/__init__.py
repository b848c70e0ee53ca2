"""Friction laws, from slip to force, and their fits; rolling resistance and terrains."""

"""Traction: observers of a robot's speed and slip, on drives of two minutes."""

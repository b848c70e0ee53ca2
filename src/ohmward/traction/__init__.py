"""Wheel, ground and robot: traction laws, slip, dynamics and power."""

"""The robot: chassis, wheels, motors, and its file."""

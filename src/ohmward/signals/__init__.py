"""Checks of sensor signals, the same for a running robot, a trial of its wiring, and a log."""

"""Checks of what sensors show: the same of a robot that runs, of a trial of its wiring, and of a log."""

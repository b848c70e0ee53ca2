"""The command `ohmward calibrate`."""

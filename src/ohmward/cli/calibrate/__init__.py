"""The command `ohmward calibrate` and its report."""

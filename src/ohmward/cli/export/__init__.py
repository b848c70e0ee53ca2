"""The command `ohmward export`."""

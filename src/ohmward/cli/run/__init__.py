"""The command `ohmward run`."""

"""The command `ohmward reproduce`."""

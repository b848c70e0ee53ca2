"""The command `ohmward learn`."""

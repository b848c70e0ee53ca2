"""The command `ohmward generic`."""

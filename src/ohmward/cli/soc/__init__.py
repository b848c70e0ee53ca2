"""The command `ohmward soc`."""

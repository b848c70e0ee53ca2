"""The command `ohmward mission`."""

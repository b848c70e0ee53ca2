"""The command `ohmward drive`."""

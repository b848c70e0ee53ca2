"""The command `ohmward demo`."""

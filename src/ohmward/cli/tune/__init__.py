"""The command `ohmward tune`."""

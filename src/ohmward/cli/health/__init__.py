"""The command `ohmward health`."""

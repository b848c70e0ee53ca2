"""The command `ohmward service`."""

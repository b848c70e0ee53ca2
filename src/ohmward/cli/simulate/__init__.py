"""The command `ohmward simulate`."""

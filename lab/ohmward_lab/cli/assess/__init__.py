"""The command `ohmward assess`."""

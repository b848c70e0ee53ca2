"""The command `ohmward slip`."""

"""The command `ohmward identify`."""

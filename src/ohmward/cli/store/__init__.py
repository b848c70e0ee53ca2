"""The command `ohmward store`."""

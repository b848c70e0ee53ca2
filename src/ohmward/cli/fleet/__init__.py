"""The command `ohmward fleet`."""

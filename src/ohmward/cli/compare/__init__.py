"""The command `ohmward compare`."""

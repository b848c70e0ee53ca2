"""The command `ohmward doctor`."""

"""The command `ohmward mission` and its report."""

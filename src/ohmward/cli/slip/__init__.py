"""The command `ohmward slip` and its report."""

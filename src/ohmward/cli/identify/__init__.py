"""The command `ohmward identify` and its report."""

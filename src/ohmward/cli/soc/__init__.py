"""The command `ohmward soc` and its report."""

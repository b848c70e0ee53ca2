"""The command `ohmward simulate` and its report."""

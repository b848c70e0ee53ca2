"""The command `ohmward compare` and its report."""

"""The command `ohmward doctor` and its report."""

"""The command `ohmward demo` and its report."""

"""The command `ohmward twin`."""

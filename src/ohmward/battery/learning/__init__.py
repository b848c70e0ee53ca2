"""Learning of a battery from its logs: one Gaussian over what the file does not know, narrowed log by log."""

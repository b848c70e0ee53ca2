"""Noise of a battery file tuned to logs without a truth, by maximum likelihood."""

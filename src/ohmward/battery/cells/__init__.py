"""Cells of a pack: their differences, the weakest cell, and the charge that can be used until it is empty."""

"""Cells of a pack: their differences, the weakest of them, and the charge that it leaves."""

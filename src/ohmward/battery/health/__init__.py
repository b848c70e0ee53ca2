"""State of health over months: capacity and resistance relative to new, and the end of life."""

"""State of health over months: capacity and resistance against new, and the time at which little is left."""

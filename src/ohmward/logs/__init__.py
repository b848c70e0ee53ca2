"""One Log type; readers and writers; units, signs, time."""

"""The battery: methods that estimate its charge, on shifts of eight hours."""

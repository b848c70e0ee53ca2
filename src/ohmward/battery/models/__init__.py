"""Models of a battery: open-circuit voltage, Thevenin and RC circuits, noise."""

"""ohmward: state of charge, wheel slip and range of battery-powered robots, with uncertainties that hold."""

__version__ = "0.1.0"

"""Dynamics of wheels and body: forces, the implicit step, power, slip."""

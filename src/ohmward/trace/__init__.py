"""The kernel compiler: a model or filter step written as NumPy, traced once, lowered to what is installed."""

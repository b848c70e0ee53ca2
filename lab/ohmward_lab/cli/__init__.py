"""Commands of the laboratory: demo, simulate, assess, reproduce."""

"""Machine code through llvmlite, where it is installed: whole logs, and many logs in SIMD lanes."""

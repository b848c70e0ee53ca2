"""Lowerings of a traced program: Python, NumPy over lanes, machine code through LLVM, C99."""

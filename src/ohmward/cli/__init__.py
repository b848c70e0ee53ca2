"""The command line: one thin file per command. Nothing here imports NumPy before a command runs."""

"""The command line.

A command is a module with EXAMPLES, `add_arguments` and `run`, or a package of two modules: its arguments, which import
nothing heavy so that --help is quick, and `command`, which does the work.
"""

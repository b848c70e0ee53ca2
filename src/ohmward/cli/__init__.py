"""The command line: `main` parses, `arguments` has the options of all commands, a module of its name runs each."""

"""The command line. Each command has a package: arguments (light, for --help), command (run), result, report."""

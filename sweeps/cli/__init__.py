"""The commands: arguments, names of outputs, exit codes."""

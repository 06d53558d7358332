"""The command line: what it accepts, what it prints, its exit codes."""

"""The command ``demos`` and its subcommands."""

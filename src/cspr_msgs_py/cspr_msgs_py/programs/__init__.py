"""The command ``cspr`` and the programs that are no nodes."""

"""The parameters of all nodes: one table, and files that give them values."""

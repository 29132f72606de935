"""Configuration files: YAML with unique keys, and the typed structures that it must fit."""

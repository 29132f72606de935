"""The settings that parameters make."""

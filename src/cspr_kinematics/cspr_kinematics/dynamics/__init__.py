"""Statics and dynamics of the platform and its payload."""

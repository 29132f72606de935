"""The supervisor: states, checks, decisions."""

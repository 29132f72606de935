"""MCAP bags: writing, reading, recovery."""

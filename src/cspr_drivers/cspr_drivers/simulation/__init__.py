"""Emulated drives and load cells on a simulated cable robot."""

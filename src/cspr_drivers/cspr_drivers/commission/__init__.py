"""Commissioning a new robot: what is found out about it, step by step, and written into `can.yaml`."""

"""Commissioning a new machine: what is found out about it, step by step, and written into `can.yaml`."""

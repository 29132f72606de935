"""Benchmarks and studies of the control stack; run with `make bench`."""

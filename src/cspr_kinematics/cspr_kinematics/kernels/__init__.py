"""Compiled kernels: each written for one pose, with compiled loops over batches beside it.

Kernels check nothing. Their callers do, and pass float64 arrays of the one type that `kernel_input` makes.
"""

"""How many threads numpy's linear algebra starts; it reads that when it is imported."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment for one: the matrices of a robot are small, and threads that wait for one another take all CPUs."""

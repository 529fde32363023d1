"""Linear algebra on one thread.

The matrices here are small: more threads cost time, slow down parallel runs, and make sums depend on the number of
threads. When the cores have other work too, the threads wait for one another: eight calibrations of a pair of cameras
took 10 s with one thread and more than 200 s with two, on two cores with a busy process on each.
"""

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment variables that must be set before NumPy is imported."""

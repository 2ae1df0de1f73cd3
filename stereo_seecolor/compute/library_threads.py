"""How many threads other libraries use: set once, by a process that does many things at once itself."""

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


def one_thread_in_libraries() -> None:
    """One thread for OpenCV and for products of matrices, unless the environment says another number. Before either is imported.

    OpenBLAS starts a thread a core for matrices of some dozen rows, and these wait in busy loops: the light of a dive took three
    times the processor time. OpenCV's threads cost a run 8 %.
    """
    for variable in VARIABLES:
        os.environ.setdefault(variable, "1")

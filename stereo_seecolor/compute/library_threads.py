"""Limits the threads of other libraries, in a process that works on many pairs at once."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PRODUCTS = "OPENBLAS_NUM_THREADS"
VARIABLES = {PRODUCTS: "numpy", "OPENCV_FOR_THREADS_NUM": "cv2"}
"""Environment variables, each read once by the library named beside it, when it is imported."""


def one_thread_in_libraries() -> None:
    """Use one thread in OpenCV and in products of matrices, if these libraries are not imported yet
    and the environment sets no other number.

    OpenBLAS starts a thread for each core for matrices of a few dozen rows, and these wait in busy
    loops: solving the light of a dive took three times the processor time. OpenCV's threads cost a
    run 8 %.
    """
    for variable, module in VARIABLES.items():
        if module not in sys.modules:
            os.environ.setdefault(variable, "1")


@contextmanager
def one_thread_in_products() -> Iterator[None]:
    """Use one thread in products of matrices in the block, where numpy is imported already."""
    if PRODUCTS in os.environ:
        yield
        return
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield

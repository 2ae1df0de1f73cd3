"""How many threads other libraries use, in a process that does many things at once itself."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PRODUCTS = "OPENBLAS_NUM_THREADS"
VARIABLES = {PRODUCTS: "numpy", "OPENCV_FOR_THREADS_NUM": "cv2"}
"""Environment variables, each read once by the library named beside it, when it is imported."""


def one_thread_in_libraries() -> None:
    """One thread for OpenCV and for products of matrices, as far as neither is imported yet, unless the environment says another
    number.

    OpenBLAS starts a thread a core for matrices of some dozen rows, and these wait in busy loops: the light of a dive took three
    times the processor time. OpenCV's threads cost a run 8 %.
    """
    for variable, module in VARIABLES.items():
        if module not in sys.modules:
            os.environ.setdefault(variable, "1")


@contextmanager
def one_thread_in_products() -> Iterator[None]:
    """The same for products of matrices alone, for a while, in a process of someone else's that has imported numpy before."""
    if PRODUCTS in os.environ:
        yield
        return
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield

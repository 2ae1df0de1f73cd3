"""Reading of numpy's files; their headers are parsed by one thread at a time.

Python 3.11 counts the depth of its parser for all threads together: where the collector of garbage
lets another thread go on in the middle of a header, both end with "SystemError: AST constructor
recursion depth mismatch".
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Lock

PARSING = Lock()
"""Held while a header is parsed."""


def load_array(path: Path) -> NDArray[Any]:
    """The array of a ``.npy`` file. Raises OSError, and ValueError where it is cut."""
    with PARSING:
        array: NDArray[Any] = np.load(path)
    return array


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an ``.npz`` file by name. Raises OSError, and ValueError or zipfile.BadZipFile
    where it is cut.
    """
    with PARSING, path.open("rb") as file, np.load(file) as content:
        return dict(content)

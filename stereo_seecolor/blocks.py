"""Images in square blocks."""

from typing import Any

from numpy.typing import NDArray


def in_blocks(values: NDArray[Any], side: int) -> NDArray[Any]:
    """The whole blocks of an image (H, W, ...): (rows, side, columns, side, ...)."""
    rows, columns = (length // side for length in values.shape[:2])
    whole = values[: rows * side, : columns * side]
    return whole.reshape(rows, side, columns, side, *values.shape[2:])

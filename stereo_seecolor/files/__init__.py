"""File formats and atomic writes: the lowest layer."""

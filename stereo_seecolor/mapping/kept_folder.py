"""Scratch folders that a map which was stopped continues from."""

import shutil
from pathlib import Path

KEY_LENGTH = 16
"""Of the hash that a folder is called by: short names, and no two are alike."""


def kept_folder(folder: Path, key: str) -> Path:
    """Name the folder in ``folder`` for work made from inputs of this hash, and delete those of other inputs.

    So a worker that was slow to hear of a new run writes into a folder that nobody reads.
    """
    kept = folder / key[:KEY_LENGTH]
    for other in folder.iterdir() if folder.is_dir() else ():
        if other != kept:
            shutil.rmtree(other, ignore_errors=True)
    return kept

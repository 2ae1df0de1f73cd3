"""Folders of work that a map which was stopped goes on from."""

import shutil
from pathlib import Path

KEY_LENGTH = 16
"""Of the hash that a folder is called by: short names, and no two are alike."""


def kept_folder(folder: Path, key: str) -> Path:
    """The folder in ``folder`` for what is made from inputs of that hash; those of other inputs are deleted.

    So a worker that was slow to hear of a new run writes into a folder that nobody reads.
    """
    kept = folder / key[:KEY_LENGTH]
    for other in folder.iterdir() if folder.is_dir() else ():
        if other != kept:
            shutil.rmtree(other, ignore_errors=True)
    return kept

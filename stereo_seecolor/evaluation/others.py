"""Corrected images of other tools, from plain folders, to be scored beside our own."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.evaluation.baselines import METHODS, OURS, PAPER
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.listing import list_images
from stereo_seecolor.records import Image


@dataclass(frozen=True, eq=False)
class OtherResults:
    """folders: name of a method -> stem of an image -> its corrected image."""

    folders: dict[str, dict[str, Path]]

    @classmethod
    def of(cls, folders: Sequence[Path]) -> "OtherResults":
        """Folders of images; a method is called as its folder.

        Raises InputError where two methods are called alike, or one holds no image.
        """
        found: dict[str, dict[str, Path]] = {}
        for folder in folders:
            name = folder.resolve().name
            if name in (*METHODS, PAPER, OURS):
                raise InputError(f"{folder}: a method that is scored anyway is called {name!r} too: rename the folder")
            if name in found:
                raise InputError(f"{folder}: another folder of results is called {name!r} too: rename one")
            found[name] = {path.stem: path for path in list_images(folder, "corrected images").files}
        return cls(found)

    def corrected(self, stem: str, shape: tuple[int, ...]) -> dict[str, NDArray[np.float64]]:
        """Method -> (H, W, 3) in [0, 1] as displayed, of the methods that have this image; NaN where it is black, as unknown.

        Raises InputError where an image is not of the size (H, W) of the one that it was made from.
        """
        results = {}
        for method, files in self.folders.items():
            if stem not in files:
                continue
            image = _of_size(files[stem], shape)
            shown = image / float(np.iinfo(image.dtype).max)
            results[method] = np.where((image == 0).all(axis=2, keepdims=True), np.nan, shown)
        return results

    def images(self, stem: str, shape: tuple[int, ...]) -> dict[str, Image]:
        """Method -> image of that stem, as it is. Raises InputError where a method has none, or one of another size."""
        for method, files in self.folders.items():
            if stem not in files:
                raise InputError(f"{method}: holds no image called {stem}: give a folder with the rectified image of every frame")
        return {method: _of_size(files[stem], shape) for method, files in self.folders.items()}


def _of_size(path: Path, shape: tuple[int, ...]) -> Image:
    image = read_image(path)
    if image.shape[:2] != shape[:2]:
        size, expected = (f"{sides[1]}x{sides[0]}" for sides in (image.shape, shape))
        raise InputError(f"{path}: is {size} px, and the image that it was made from is {expected}: resize it")
    return image

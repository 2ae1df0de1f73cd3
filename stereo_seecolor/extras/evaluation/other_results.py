"""Corrected images of other tools, read from folders, to be scored beside this program's."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.baselines import METHODS, OURS, PAPER
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.listing import list_images
from stereo_seecolor.records import Image


@dataclass(frozen=True, eq=False)
class OtherResults:
    """Corrected images of other tools. folders: method -> stem of an image -> its result."""

    folders: dict[str, dict[str, Path]]

    @classmethod
    def of(cls, folders: Sequence[str | Path]) -> "OtherResults":
        """The images in these folders; a method has the name of its folder, or the one before it:
        ``name=folder``.

        Raises InputError where two methods have the same name, or a folder holds no image, or two
        of the same name.
        """
        found: dict[str, dict[str, Path]] = {}
        for given in folders:
            named, _, place = str(given).rpartition("=")
            folder = Path(given) if not named or Path(given).exists() else Path(place)
            name = named if folder != Path(given) else folder.resolve().name
            if name in (*METHODS, PAPER, OURS):
                raise InputError(
                    f"{folder}: a method of the table already has the name {name!r}: give "
                    "another name, name=folder"
                )
            if name in found:
                raise InputError(
                    f"{folder}: another folder of results has the name {name!r}, too: give "
                    "another name, name=folder"
                )
            found[name] = _by_stem(list_images(folder, "corrected images").files)
        return cls(found)

    def missing(self, stems: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Method -> the stems of these images that it lacks, for methods that lack any."""
        lacking = {
            method: tuple(stem for stem in stems if stem not in files)
            for method, files in self.folders.items()
        }
        return {method: names for method, names in lacking.items() if names}

    def refuse_other_names(self, stems: Sequence[str]) -> None:
        """Raise InputError where a method has none of these images: its files have other names."""
        for method, files in self.folders.items():
            if files.keys().isdisjoint(stems):
                raise InputError(
                    f"{method}: none of its images has the name of an image to score: its first "
                    f"is {min(files)!r}, the first to score is {min(stems)!r}: name its "
                    "images like their source images"
                )

    def corrected(self, stem: str, shape: tuple[int, ...]) -> dict[str, NDArray[np.float64]]:
        """Method -> (H, W, 3) in [0, 1] as displayed, of the methods that have this image; NaN
        where it is black, as unknown.

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
        """Method -> its image of that stem, unchanged; all methods must have it. Raises InputError
        where one has another size.
        """
        return {method: _of_size(files[stem], shape) for method, files in self.folders.items()}


def _by_stem(files: Iterable[Path]) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in files:
        if path.stem in found:
            raise InputError(
                f"{path}: {found[path.stem].name} has the same name: leave only one of them in "
                "the folder"
            )
        found[path.stem] = path
    return found


def _of_size(path: Path, shape: tuple[int, ...]) -> Image:
    image = read_image(path)
    if image.shape[:2] != shape[:2]:
        size, expected = (f"{sides[1]}x{sides[0]}" for sides in (image.shape, shape))
        raise InputError(f"{path}: is {size} px, but its source image is {expected}: resize it")
    return image

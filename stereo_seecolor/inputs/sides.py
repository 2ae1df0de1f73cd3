"""Which of a dive's folders, files or videos is the left side, and which the right."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, product
from operator import itemgetter
from pathlib import Path
from shlex import quote

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.image_headers import image_size
from stereo_seecolor.files.names import natural_key
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.listing import (
    EXTENSIONS,
    folder_parts,
    holds_images,
    inner_folders,
    list_images,
    unread_hint,
)
from stereo_seecolor.inputs.name_keys import side_of
from stereo_seecolor.inputs.range_maps import holds_floats
from stereo_seecolor.inputs.video_frames import is_video

DEPTH = 3
"""Levels of folders that are searched for images: a dive, a camera, a format;"""
DEEPEST = 6
"""and where these hold none: a dataset, a dive, a vehicle, a kind of sensor, a camera, a format."""

WIDEST = 2.0
"""Width over height of two square images side by side; the widest sensors have 1.9 (17:9)."""

MAX_FOLDERS = 12
"""Folders with the most images that are tried as sides, each with each."""

_NUMBER = re.compile(r"(?P<side>cam[01](?!\d))|\d+", re.IGNORECASE)
"""A number in a name; that of ``cam0`` and ``cam1`` tells the side."""


@dataclass(frozen=True)
class Sides:
    """Two folders of images (or patterns for the names in one), or two videos; the same folder or
    video twice shows both.

    guessed: no name says which side is which. others: folders of the same names elsewhere, as of
    another hour or dive, and those beside a side's, as a day that the other side lacks.
    """

    left: Path
    right: Path
    guessed: bool = False
    others: tuple[Path, ...] = ()

    @property
    def together(self) -> tuple[Path, Path] | None:
        """Patterns for these folders and all the others, as of a dive cut into hours; None where
        one pattern a side has not all.
        """
        for place in range(1, len(self.left.parts)):
            left, right = (
                Path(*side.parts[:place], "*", *side.parts[place + 1 :])
                for side in (self.left, self.right)
            )
            with suppress(InputError):  # matches folders of both sides
                lefts, rights = folder_parts(left).values(), folder_parts(right).values()
                found = sorted([*lefts, *rights])
                alike = len(lefts) == len(rights)
                if alike and found == sorted((self.left, self.right, *self.others)):
                    return left, right
        return None


def find_sides(places: Sequence[Path]) -> Sides:
    """The two sides among ``places``: two folders, one or two videos, or a folder with them.

    Raises InputError if a place is missing, or if no two sides are found.
    """
    videos = [path for path in places if is_video(path)]
    folders = [path for path in places if path not in videos]
    images: dict[Path, int] = {}
    for depth, through_links in product((DEPTH, DEEPEST), (False, True)):
        for folder in folders:
            found, found_videos = _look_through(folder, depth, through_links)
            images |= found
            videos += found_videos
        if images or videos:
            break
    if len(images) >= 2:
        among = _given(folders, images) if len(places) == 2 else {}
        sides = _both_in_each(images) or _best_pair(among or images | _parents(images))
        names = {sides.left.name, sides.right.name}
        both = {sides.left, sides.right}
        cut = {side.parent for side in both} if sides.left.parent != sides.right.parent else set()
        others = [
            one
            for one in images
            if (one.name in names or one.parent in cut) and not both & {one, *one.parents}
        ]
        return replace(sides, others=tuple(sorted(others, key=lambda path: natural_key(str(path)))))
    if videos:
        return _of_videos(sorted(set(videos), key=lambda path: natural_key(path.name)))
    if images:
        (folder,) = images
        return _in_one_folder(folder)
    hint = unread_hint(str(path) for folder in folders for path in sorted(folder.rglob("*")))
    raise InputError(
        f"{', '.join(map(str, places))}: no images ({', '.join(sorted(EXTENSIONS))}) and no videos "
        f"were found, up to {DEEPEST} folders deep: give the folders of the two sides{hint}"
    )


def _look_through(
    root: Path, depth: int, through_links: bool
) -> tuple[dict[Path, int], list[Path]]:
    """Folders with the number of images directly in each, and videos, down to ``depth``; hidden
    folders are passed over.

    through_links: folders that are links, too; a link to a side would make a third one.
    """
    if not root.is_dir():
        raise InputError(f"{root}: does not exist, or is neither a folder nor a video")
    images: dict[Path, int] = {}
    videos: list[Path] = []
    for folder, below, names in os.walk(root, followlinks=through_links):
        here = Path(folder)
        below[:] = sorted(
            name for name in below if name[0] != "." and len(here.relative_to(root).parts) < depth
        )
        count = sum(Path(name).suffix.lower() in EXTENSIONS and name[0] != "." for name in names)
        images |= {here: count} if count else {}
        videos += [here / name for name in names if is_video(here / name)]
    return images, videos


def _given(folders: Sequence[Path], images: dict[Path, int]) -> dict[Path, int]:
    """Two folders that were given, each with images in it or in its inner folders: the two sides,
    never cut; else none.
    """
    found = {
        folder: images.get(folder) or sum(images.get(one, 0) for one in inner_folders(folder))
        for folder in folders
    }
    return found if len(found) == 2 and all(found.values()) else {}


def video_of(side: Path) -> Path:
    """The one video of a folder without images, as a camera's card is (``DCIM/100GOPRO``, with
    reduced copies and thumbnails beside it); the side itself where it is anything else.
    """
    if is_video(side) or not side.is_dir() or holds_images(side) or inner_folders(side):
        return side
    images, videos = _look_through(side, DEPTH, False)
    shown = [video for video in videos if not video.name.startswith(".")]
    return shown[0] if len(shown) == 1 and not images else side


def _parents(images: dict[Path, int]) -> dict[Path, int]:
    """Folders that hold no images themselves, but several folders of them: a camera's, cut by time
    or by number.
    """
    found = {
        parent: inner_folders(parent)
        for parent in {folder.parent for folder in images} - images.keys()
    }
    return {
        parent: sum(images.get(one, 0) for one in inner)
        for parent, inner in found.items()
        if len(inner) > 1
    }


def _both_in_each(images: Iterable[Path]) -> Sides | None:
    """Patterns for folders that each hold both sides' images (``set_1/LFT_3.tif``,
    ``set_1/RGT_3.tif``); else None.
    """
    found: set[tuple[Path, Path]] = set()
    shared = set.intersection(*(set(folder.parts) for folder in images))
    for folder in images:
        if any(map(side_of, set(folder.parts) - shared)):
            return None
        try:
            sides = _in_one_folder(folder)
        except InputError:
            return None
        if sides.guessed or sides.left == folder:
            return None
        found.add((folder.parent / "*" / sides.left.name, folder.parent / "*" / sides.right.name))
    return Sides(*found.pop()) if len(found) == 1 else None


def _in_one_folder(folder: Path) -> Sides:
    """Patterns for the two sides of one folder: names that differ not in numbers alone."""
    files = list_images(folder, "images").files
    shapes = Counter(_NUMBER.sub(lambda found: found["side"] or "*", path.name) for path in files)
    if len(shapes) > 1:
        return _best_pair({folder / shape: count for shape, count in shapes.items()})
    if holds_floats(files[0]):
        raise InputError(
            f"{folder}: holds floating-point numbers, no images: if these are range maps in "
            f"meters, run: stereo-seecolor correct --images IMAGES --range {quote(str(folder))}"
        )
    if side := side_of(folder.name):
        raise InputError(
            f"{folder}: holds the {side} images only: give the folder of the other side, too, or "
            "the folder that contains both"
        )
    if _shows_both(files[0]):
        return Sides(folder, folder)
    fix = "move the left and the right images into separate folders"
    raise InputError(f"{folder}: holds all images in one folder, and no name shows its side: {fix}")


def _shows_both(first: Path) -> bool:
    """Whether each image may show both sides, by the shape of the first."""
    try:
        width, height = image_size(read_image_bytes(first))
    except (InputError, ValueError):
        return False
    return width >= WIDEST * height or height > width


def _best_pair(images: dict[Path, int]) -> Sides:
    """The two folders that name sides and give the most pairs; else in natural order."""
    largest = sorted(images, key=lambda path: -images[path])[:MAX_FOLDERS]
    both = list(combinations(sorted(largest, key=lambda path: natural_key(str(path))), 2))
    # a folder sorts before those in it
    both = [sides for sides in both if sides[0] not in sides[1].parents]
    named = [
        (_left_first(*sides), True) for sides in both if set(_sides_of(*sides)) == {"left", "right"}
    ]
    for choices in (named, [(sides, False) for sides in both]):
        pairs, (sides, known) = max(
            ((_pairs(*choice[0]), choice) for choice in choices),
            key=itemgetter(0),
            default=(0, (both[0], False)),
        )
        if pairs:
            return Sides(*sides, guessed=not known)
    first, second = both[0]
    if len(both) == 1:
        pair_sides(first, second, InputConfig())  # raises with the reason
    raise InputError(
        f"{first} and {second}: no two of the {len(images)} folders or groups of images contain "
        "pairs: give the two sides of one dive"
    )


def _left_first(first: Path, second: Path) -> tuple[Path, Path]:
    return (first, second) if _sides_of(first, second)[0] == "left" else (second, first)


def _sides_of(first: Path, second: Path) -> tuple[str | None, str | None]:
    """The sides by the parts of the paths that tell them apart: ``cam0/data`` and ``cam1/data``
    differ in the folder above.
    """
    parts = next(
        (both for both in zip(first.parts, second.parts, strict=False) if both[0] != both[1]),
        (first.name, second.name),
    )
    return side_of(parts[0]), side_of(parts[1])


def _pairs(left: Path, right: Path) -> int:
    try:
        return len(pair_sides(left, right, InputConfig()).pairs)
    except InputError:
        return 0


def _of_videos(videos: list[Path]) -> Sides:
    if len(videos) == 1:
        return Sides(videos[0], videos[0])
    named = {side_of(path.stem): path for path in videos}
    if len(videos) == 2:
        left, right = named.get("left"), named.get("right")
        return Sides(left, right) if left and right else Sides(videos[0], videos[1], guessed=True)
    raise InputError(
        f"{', '.join(path.name for path in videos[:6])}: {len(videos)} videos were found: give "
        "the two of one dive"
    )

"""The pairs of a dive: of two folders, many folders a side, or images of both sides."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from calibration.errors import counted
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import product_name, stem_of
from stereo_seecolor.inputs.halves import pair_halves
from stereo_seecolor.inputs.listing import FolderFiles, Unpaired, folder_parts, list_images
from stereo_seecolor.inputs.name_keys import without_side
from stereo_seecolor.inputs.pairing import (
    DivePairs,
    Pair,
    Pairing,
    in_dive_order,
    pair_folders,
    with_unique_names,
)


def pair_sides(left: Path, right: Path, config: InputConfig) -> Pairing:
    """The pairs of two sides as pair_folders, or, of one, the halves of each image.

    Of sides that are cut into folders in which names begin anew (``10h/0001.png``,
    ``11h/0001.png``), each folder's pairs, called after both. Raises InputError as pair_folders.
    """
    lefts, rights = (
        _by_key(folder_parts(source), side) for source, side in ((left, "left"), (right, "right"))
    )
    if min(len(lefts), len(rights)) > 1 and (_names_repeat(lefts) or _names_repeat(rights)):
        return _folder_by_folder(lefts, rights, config)
    return _paired(left, right, config)


def _paired(left: Path, right: Path, config: InputConfig) -> Pairing:
    return (
        pair_halves(list_images(left, "images"), config.right_half_first)
        if left == right
        else pair_folders(left, right, config)
    )


def _by_key(parts: dict[str, Path], side: str) -> dict[str, Path]:
    """The same without the word for the side in the keys (``10h_left``, ``10h_right``), unless two
    would then be alike.
    """
    bare = {without_side(key, side): part for key, part in parts.items()}
    return bare if len(bare) == len(parts) else parts


def _names_repeat(parts: dict[str, Path]) -> bool:
    stems = Counter(stem for part in parts.values() for stem in _stems(part))
    return any(count > 1 for count in stems.values())


def _stems(source: Path) -> Iterator[str]:
    files = list_images(source, "images").files
    return (
        (stem_of(name) for name in files.names)
        if isinstance(files, FolderFiles)
        else (path.stem for path in files)
    )


def _folder_by_folder(
    lefts: dict[str, Path], rights: dict[str, Path], config: InputConfig
) -> Pairing:
    """Folders of the same key are paired, in the left ones' order; others have no partner."""
    pairs: list[Pair] = []
    unpaired: list[Unpaired] = []
    notes: dict[str, None] = {}
    for key, left in lefts.items():
        if key in rights:
            try:
                found = _paired(left, rights[key], config)
            except InputError as error:
                unpaired += [*_alone(left, str(error)), *_alone(rights[key], str(error))]
                continue
            pairs += [
                replace(pair, name=product_name(f"{key}_{pair.name}")) for pair in found.pairs
            ]
            unpaired += found.unpaired
            notes |= dict.fromkeys(found.notes)
    for side, parts, others in (("right", lefts, rights), ("left", rights, lefts)):
        for key in parts.keys() - others.keys():
            unpaired += _alone(parts[key], f"there is no {side} folder {key}")
    if not pairs:
        raise InputError(
            f"no left folder has a right folder of the same name: {', '.join(lefts)} and "
            f"{', '.join(rights)}"
        )
    both = f"{counted(len(lefts.keys() & rights.keys()), 'folder')} a side"
    anew = (
        f"the same file names occur in each of {both}: pairs are named after folder and file, "
        f"the first {pairs[0].name}"
    )
    pairs = _in_order(with_unique_names(pairs, str))
    return Pairing(DivePairs.of(pairs), tuple(unpaired), (anew, *notes))


def _alone(source: Path, reason: str) -> list[Unpaired]:
    return [Unpaired(path, reason) for path in list_images(source, "images").files]


def _in_order(pairs: list[Pair]) -> list[Pair]:
    """By time, or by folder and name; times that come again count from each folder's begin, and are
    no times of the dive.
    """
    times = Counter(pair.timestamp_s for pair in pairs)
    if any(count > 1 for time_s, count in times.items() if time_s is not None):
        pairs = [replace(pair, timestamp_s=None) for pair in pairs]
    return in_dive_order(pairs)

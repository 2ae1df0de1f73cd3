"""Whether a run may use a folder: whose results it holds, what --overwrite may delete."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from stereo_seecolor.compute.names import Names
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.names import is_log
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.run_folder.layout import (
    DIVE_FILES,
    INDEX,
    LEASE,
    LOCK,
    MANIFEST,
    MAP,
    MEASURED_WATER,
    ORIGINAL,
    PAGE,
    PAGE_PRODUCTS,
    PLAN,
    PRODUCTS,
    STATE,
    state,
)
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest
from stereo_seecolor.run_folder.own_paths import refuse_links
from stereo_seecolor.run_folder.replaced_results import refuse_inputs

BEFORE_A_RUN = frozenset({LOCK, LEASE, PLAN})
"""In the program's own folder before a first run."""
NAMES_OF_SYSTEMS = frozenset({"Thumbs.db", "desktop.ini", "@eaDir"})
"""What file managers leave in every folder that is opened; hidden files are ignored too."""


COMPARED_FRAMES = 5
"""Frames compared to recognize a moved dive: the first, the last and three between."""


class Files(Protocol):
    """A pair's name, and the files that it is made of."""

    @property
    def name(self) -> str:
        """Its name in OUT."""

    @property
    def left(self) -> Path:
        """The left image."""

    @property
    def right(self) -> Path:
        """The right image, or a range map."""


@dataclass(frozen=True)
class Owner:
    """The owner of a folder's results.

    kind: the command that made it. inputs: what was given, by name. sample: hash of the content of
    the dive's first file. pairs: of the dive; none for videos, which are opened later. By both a
    dive is recognized that was moved.
    """

    kind: str
    inputs: Mapping[str, str]
    sample: str = ""
    pairs: Sequence[Files] = ()

    def identity(self) -> dict[str, str]:
        """The owner as the manifest stores it."""
        return {"kind": self.kind, "sample": self.sample, **self.inputs}

    def owns(self, manifest: Manifest) -> bool:
        """Tell whether a folder is this dive's: made by the same command from the same paths, or
        from the same files elsewhere.

        The same path may hold another dive's files of the same names, as a memory card does: then
        not one of some is the same.
        """
        identity = manifest.dive().identity
        if identity.get("kind") != self.kind:
            return False
        recorded = Names(manifest.names())
        common = [number for number, pair in enumerate(self.pairs) if pair.name in recorded]
        if {**identity, "sample": ""} == {**self.identity(), "sample": ""}:
            return len(common) < 2 or any(self._same_files(common, manifest))
        if not self.pairs:
            return bool(self.sample) and identity.get("sample") == self.sample
        grew_or_shrank = len(common) >= max(min(len(recorded), len(self.pairs)), 1)
        return grew_or_shrank and all(self._same_files(common, manifest))

    def _same_files(self, common: Sequence[int], manifest: Manifest) -> Iterator[bool]:
        """Whether the files of some of the frames of these numbers are those that are recorded."""
        steps = range(min(COMPARED_FRAMES, len(common)))
        for number in dict.fromkeys(
            common[step * (len(common) - 1) // max(steps[-1], 1)] for step in steps
        ):
            yield _same_files(self.pairs[number], manifest.frame(self.pairs[number].name))


def _same_files(pair: Files, record: FrameRecord | None) -> bool:
    """True also for a record that is damaged: its frame is made again."""
    known = {file.sha256 for file in record.inputs.values()} if record else set()
    return not known or known <= {
        hashlib.sha256(read_bytes(path)).hexdigest() for path in (pair.left, pair.right)
    }


@dataclass(frozen=True)
class FolderRequest:
    """How a run takes OUT.

    owner: the dive and command. overwrite: delete earlier results first. inputs: files and folders
    that the run reads, never to be deleted. unchanged: names in OUT that it leaves as they are, or
    writes again with the content that it reads. ranges: hash of the settings that it makes range
    maps with, "" if not known yet: a water measured in others is stale then.
    """

    owner: Owner
    overwrite: bool = False
    inputs: tuple[Path, ...] = ()
    unchanged: tuple[str, ...] = ()
    ranges: str = ""


def check_ownership(manifest: Manifest, request: FolderRequest) -> None:
    """Refuse a folder that is not this dive's, or that holds files of others in a product's place,
    or the run's inputs; nothing is changed. Raises OutputError.
    """
    root = manifest.root
    refuse_links(root)
    if not manifest.exists():
        refuse_used(root)
        return
    dive = manifest.dive()
    if not request.overwrite and _holds_results(manifest) and not request.owner.owns(manifest):
        raise OutputError(
            f"{root}: contains the results of another dive or command: choose another output "
            "folder, or delete this one (run: --overwrite)"
        )
    measured = not request.overwrite and request.ranges in ("", dive.settings.get("range"))
    refuse_inputs(
        "run", root, request.inputs, (*request.unchanged, *([MEASURED_WATER] if measured else []))
    )
    refuse_files_of_others(manifest)


def _holds_results(manifest: Manifest) -> bool:
    """False after a run that was refused before its first pair, as for exchanged sides."""
    return bool(manifest.names() or manifest.dive().files)


def is_unused(root: Path) -> bool:
    """Tell whether the program's own folder holds nothing but what a run begins with."""
    return set(_names(state(root))) <= BEFORE_A_RUN | {MANIFEST}


def refuse_used(root: Path) -> None:
    """Raise OutputError where a folder without a manifest holds anything."""
    entries = _names(root)
    own = STATE if not set(_names(state(root))) - BEFORE_A_RUN else None
    foreign = [
        name for name in entries if name != own and not _of_system(name) and not is_log(root / name)
    ]
    if foreign:
        raise OutputError(
            f"{root}: holds other files ({foreign[0]}): choose another --out, an empty or a new "
            "folder; nothing was changed"
        )


def refuse_files_of_others(manifest: Manifest) -> None:
    """Raise OutputError where a product's folder holds what the program did not write."""
    known = {*manifest.names()}
    for product in (*PRODUCTS, *PAGE_PRODUCTS):
        if not product.startswith(f"{ORIGINAL}/"):
            for path in files_below(manifest.root / product):
                if not _of_system(path.name) and path.stem not in known:
                    raise _foreign(path)
    _refuse_foreign_originals(manifest)
    files = manifest.dive().files
    frames_folders = {manifest.root / product for product in PAGE_PRODUCTS}
    for path in (*files_below(manifest.root / MAP), *files_below(manifest.root / PAGE)):
        if not frames_folders.isdisjoint(path.parents) or _of_system(path.name):
            continue
        if path.relative_to(manifest.root).as_posix() not in files:
            raise _foreign(path)
    for name in (*DIVE_FILES, INDEX):
        if (manifest.root / name).exists() and name not in files:
            raise _foreign(manifest.root / name)


def _refuse_foreign_originals(manifest: Manifest) -> None:
    """Products in the camera's pixels have its images' names: each record knows them."""
    found = [path for path in files_below(manifest.root / ORIGINAL) if not _of_system(path.name)]
    known = {path for frame in manifest.frames() for path in frame.files} if found else set()
    for path in found:
        if path.relative_to(manifest.root).as_posix() not in known:
            raise _foreign(path)


def _names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []


def _of_system(name: str) -> bool:
    return (name.startswith(".") and name != STATE) or name in NAMES_OF_SYSTEMS


def _foreign(path: Path) -> OutputError:
    return OutputError(
        f"{path}: was not written by this program, and has the path of a result: move it "
        "elsewhere; nothing was changed"
    )

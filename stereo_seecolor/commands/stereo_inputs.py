"""The stereo pairs and the calibration that a command is given, and the pipeline for them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Protocol

from calibration.suspicions import suspicions
from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.checks.changes import LEFT_OUT, DiveChange, find_change
from stereo_seecolor.checks.dive import IMAGE_CHECKS
from stereo_seecolor.checks.rig import check_rig
from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.checks.verdict import RANGES, verdict_of
from stereo_seecolor.commands.rig_loading import load_rig_for
from stereo_seecolor.commands.rig_refinement import refined_for_dive
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.whole_files import read_bytes, special_kind
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.file_form import as_stored, stored_facts, stored_notes
from stereo_seecolor.inputs.listing import folders_of
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.inputs.sides import video_of
from stereo_seecolor.inputs.video_frames import is_video
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.plugins import load
from stereo_seecolor.run_folder.cache import KeptRigCheck
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.ownership import Owner
from stereo_seecolor.version import __version__

STORAGE_PAIRS = 6
"""Pairs that are examined for how images store their pixels: one dark frame must not decide."""

SAMPLE_BYTES = 1 << 20
"""Bytes at the beginning, in the middle and at the end of a video that tell it from others."""


class DiveInputs(Protocol):
    """What a command is given of a dive: ``StereoInputs``, or a recording of both sides."""

    @property
    def names(self) -> dict[str, str]:
        """For run.json."""

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file and folder that is read."""

    def owner(self, kind: str, opened: "Opened | None") -> Owner:
        """The owner of an OUT with results of these inputs. opened: None: opened in the folder."""

    def open_first(self, config: RunConfig) -> "Opened | None":
        """The pairs and their pipeline; None for inputs of which OUT keeps how they were opened:
        ``open_in`` opens these.
        """

    def open_in(self, folder: RunFolder, config: RunConfig) -> "Opened":
        """``open_first`` once the output folder was taken."""


@dataclass(frozen=True, eq=False)
class StereoInputs:
    """The two sides and the calibration of a dive. left, right: folders of images, patterns,
    videos, or folders of one video. calib: as for load_rig.
    """

    left: Path
    right: Path
    calib: str | Path

    def __post_init__(self) -> None:
        for side in ("left", "right"):
            object.__setattr__(self, side, video_of(Path(getattr(self, side))))
        video, other = sorted((self.left, self.right), key=is_video, reverse=True)
        if is_video(video) and not is_video(other):
            raise InputError(
                f"{video} is a video, and {other} is none that is read: give videos of both "
                "sides, or folders of images of both"
            )

    @property
    def names(self) -> dict[str, str]:
        """For run.json."""
        return {"left": str(self.left), "right": str(self.right), "calib": str(self.calib)}

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file and folder that is read."""
        return (*folders_of(self.left), *folders_of(self.right), *calibration_files(self.calib))

    def owner(self, kind: str, opened: "Opened | None") -> Owner:
        """The owner of an output folder with results of these inputs: recognized by their paths, or
        by the first file's content.

        opened: None for videos.
        """
        paths = {"left": str(self.left.resolve()), "right": str(self.right.resolve())}
        pairs = opened.pairing.pairs if opened else ()
        return Owner(kind, paths, sample(pairs[0].left if pairs else self.left), pairs)

    def open_first(self, config: RunConfig) -> "Opened | None":
        """``open`` for images, before OUT is touched; None for videos, see ``open_in``."""
        return None if is_video(self.left) and is_video(self.right) else self.open(config)

    def open(self, config: RunConfig) -> "Opened":
        """The pairs of two folders of images, and the pipeline for their rig. Raises InputError,
        CalibrationError.

        Doubts about a rig that can be used are added to the pairing's notes.
        """
        pairing = pair_sides(self.left, self.right, config.input)
        config, notes = settle_storage(config, pairing.pairs)
        return self._opened(pairing.with_notes(notes), config)

    def open_in(self, folder: RunFolder, config: RunConfig) -> "Opened":
        """The pairs of two videos, and the pipeline for their rig; OUT keeps the choice.

        Raises as ``open``, and DeviceError if the library for videos is missing.
        """
        pairing = load("inputs", "videos").video_pairing(
            self.left, self.right, self.calib, folder, config.input
        )
        return self._opened(pairing, config)

    def _opened(self, pairing: Pairing, config: RunConfig) -> "Opened":
        if config.output.geometry == "original":
            _refuse_equal_names(pairing)
        rig = load_rig_for(self.calib, pairing.pairs, config.input)
        config, response_notes = settle_response(config, pairing.pairs)
        notes = tuple(f"calibration: {suspicion}" for suspicion in suspicions(rig))
        return Opened(pairing.with_notes(notes + response_notes), Pipeline(rig, config))


def settle_storage(config: RunConfig, pairs: Sequence[Pair]) -> tuple[RunConfig, tuple[str, ...]]:
    """Settle ``input.bayer`` and ``input.significant_bits`` where they are auto, from images spread
    over the dive.

    Returns the settings, and notes on what was found.
    """
    facts = stored_facts(config.input, evenly_spaced(pairs, STORAGE_PAIRS))
    images = as_stored(config.input, facts)
    return config.model_copy(update={"input": images}), stored_notes(config.input, images)


@dataclass(frozen=True, eq=False)
class Opened:
    """The pairs that a command works on, and the pipeline of their rig."""

    pairing: Pairing
    pipeline: Pipeline

    def for_dive(self, folder: RunFolder, options: RunOptions) -> "Opened":
        """Ask a dive's images all checks, and refine the rig where the settings ask for it.

        Returns the inputs with notes on both, and with the pipeline of the refined rig.
        """
        pairs, pipeline = self.pairing.pairs, self.pipeline
        of_images = verdict_of(IMAGE_CHECKS, DiveImages.with_colors(pairs, pipeline.config))
        pairing = self.pairing.with_notes(of_images.notes, of_images.wrong)
        images = pipeline.config.input
        key = content_key(__version__, pipeline.settings, images.refine, len(pairs), pairs[-1].name)
        known, change = KeptRigCheck.load(folder.root, key), DiveChange()
        if known is None:
            change = find_change(pipeline.rectification, pairs, images)
        if change.out_of_step:
            raise InputError(change.line)
        if images.refine:
            shared = change.shared(pairs)
            rig, note = refined_for_dive(pipeline.rig, shared, images, folder, options)
            pairing = pairing.with_notes((note,))
            pipeline = pipeline if rig is pipeline.rig else Pipeline(rig, pipeline.config)
        if known is None:
            found = check_rig(pipeline, pairs, change)
            left_out = dict.fromkeys(change.odd, LEFT_OUT)
            known = KeptRigCheck(found.notes, bool(found.wrong), found.measured, left_out)
            known.save(folder.root, key)
        elif not known.ranges_are_wrong:  # an earlier run into this folder has given these notes
            known = replace(known, notes=())
        pairing = pairing.with_notes(known.notes, RANGES if known.ranges_are_wrong else frozenset())
        return Opened(replace(pairing, ranges=known.ranges, left_out=known.left_out), pipeline)

    def part(self, shard: Shard) -> "Opened":
        """The inputs of one shard: its pairs; the first has the files without a partner, too."""
        if shard.whole:
            return self
        pairs = tuple(shard.part(self.pairing.pairs))
        note = (
            f"shard {shard}: {len(pairs)} of {len(self.pairing.pairs)} pairs; when all shards "
            "are done: stereo-seecolor merge"
        )
        unpaired = self.pairing.unpaired if shard.number == 1 else ()
        of_dive = len(self.pairing.pairs)
        own = replace(self.pairing, pairs=pairs, unpaired=unpaired, of_dive=of_dive)
        return replace(self, pairing=own.with_notes((note,)))


def _refuse_equal_names(pairing: Pairing) -> None:
    """Raise InputError if left images share a name: files in OUT/original have these."""
    seen: dict[str, Path] = {}
    for pair in pairing.pairs:
        other = seen.setdefault(pair.left.stem.casefold(), pair.left)
        if other != pair.left:
            raise InputError(
                f"{other} and {pair.left}: would both be {other.stem} in OUT/original: rename "
                "one, or set output.geometry=rectified"
            )


def calibration_files(calib: str | Path) -> Iterator[Path]:
    """Every file that a calibration may be read from: named ones, and those in named folders."""
    for place in (Path(part) for part in str(calib).split(",") if part):
        yield place
        if place.is_dir():
            yield from (path for path in place.iterdir() if path.is_file())


def sample(path: Path) -> str:
    """Hash of a dive's first image, or of pieces of its video, by which it is recognized elsewhere.

    Raises InputError where the file cannot be read.
    """
    if not is_video(path):
        return content_key(read_bytes(path))
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a video")
        size = path.stat().st_size
        with path.open("rb") as file:
            return content_key(
                size,
                *(_piece(file, place) for place in (0, size // 2, max(size - SAMPLE_BYTES, 0))),
            )
    except OSError as error:
        raise InputError(f"{path}: the video cannot be read: {error.strerror}") from error


def _piece(file: BinaryIO, place: int) -> bytes:
    file.seek(place)
    return file.read(SAMPLE_BYTES)

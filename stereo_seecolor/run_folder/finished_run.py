"""A finished run read back: its settings, rig, frames and products, as the run recorded them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError, RectifiedPair, StereoRig
from calibration.bounded_text import load_json
from calibration.formats import load_rig
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.json_records import as_record
from stereo_seecolor.files.reading import read_bytes
from stereo_seecolor.records import Map
from stereo_seecolor.run_folder.layout import FRAMES_TABLE, RIG, RUN, WATER
from stereo_seecolor.run_folder.manifest import DiveRecord, FrameRecord, Manifest
from stereo_seecolor.run_folder.own_paths import refuse_links_out

RUN_FORMAT, RUN_VERSION = "stereo-seecolor/run", 2
YEAR_2000 = 946_684_800


@dataclass(frozen=True)
class FinishedFrame:
    """A pair that went through all stages.

    timestamp_s: as the inputs give it. left: the raw left image as it was given, which may be gone since. sha256: of that image.
    sha256_right: of the right one, "" where there is none.
    products: name -> file in OUT. facts: the frame's columns of frames.csv.
    """

    name: str
    timestamp_s: float | None
    left: Path
    sha256: str
    products: dict[str, Path]
    facts: dict[str, float] = field(default_factory=dict)
    sha256_right: str = ""

    @property
    def taken(self) -> datetime | None:
        """The time of the frame in UTC; None without a time stamp, and for one before the year 2000, which is a counter and no
        date.
        """
        stamp_s = self.timestamp_s or 0.0
        return datetime.fromtimestamp(stamp_s, UTC) if stamp_s > YEAR_2000 else None

    def read(self, product: str) -> NDArray[Any]:
        """Read the pixels of a product as stored, (H, W) or (H, W, 3) RGB. Raises InputError if it was not written, or is
        damaged.
        """
        path = self.products.get(product)
        if path is None:
            raise InputError(f"{self.name}: the run wrote no {product}: run again with it turned on")
        try:
            return read_array(path)
        except InputError as error:
            raise InputError(f"{path}: is gone or damaged: run again, which makes it again") from error

    def measured_range_m(self) -> Map:
        """Read the measured ranges: (H, W) float32 meters along the ray, NaN where nothing was measured. Raises InputError."""
        return np.where(self.read("confidence") > 0, self.read("range"), np.float32(np.nan))


@dataclass(frozen=True)
class _Described:
    """What run.json says beside settings and geometry; as ``reports`` writes it."""

    version: str
    date: str
    command_line: list[str]
    libraries: dict[str, str | None]
    inputs: dict[str, str | dict[str, Any]]
    frames: list[str]
    totals: dict[str, Any]
    working_directory: str = ""
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Totals:
    """Those of its totals that commands use."""

    stage_seconds: dict[str, float]
    notes: list[str]


@dataclass(frozen=True)
class FinishedRun:
    """OUT/ as it is now; made by ``open_run``.

    config: the run's own settings. geometry: of the rectified images; None for ``correct``, which knows no camera.
    T_rectified_left: (4, 4), from the raw left camera's axes. frames: those that are finished and current, in the dive's order.
    state: whether the latest run came to its end. stale: frames whose products are of earlier settings.
    totals: the numbers of the latest run's summary. inputs: what the run was given, by name. version: of the program.
    made: when, as ISO 8601. libraries: versions by name. command_line: as it was given.
    """

    root: Path
    config: RunConfig
    geometry: RectifiedPair | None
    T_rectified_left: NDArray[np.float64] | None
    frames: Sequence[FinishedFrame]
    state: Literal["running", "stopped", "complete"]
    stale: tuple[str, ...]
    totals: dict[str, Any]
    inputs: dict[str, str]
    version: str
    made: str
    libraries: dict[str, str | None]
    command_line: tuple[str, ...]

    @property
    def water_file(self) -> Path:
        """The file of the fitted water."""
        return self.root / WATER

    @cached_property
    def rig(self) -> StereoRig:
        """The calibration as the run used it. Raises InputError for a run that knows no camera, CalibrationError if damaged."""
        if self.geometry is None:
            raise InputError(f"{self.root}: the run knows no camera (made by correct?): this needs the output of run")
        return load_rig(str(self.root / RIG))

    def frame(self, name: str) -> FinishedFrame:
        """Find a frame by its name. Raises InputError if the run holds none of that name."""
        found = self._by_name.get(name)
        if found is None:
            raise InputError(f"{self.root}: holds no finished frame {name!r}: {FRAMES_TABLE} lists what became of each pair")
        return found

    @cached_property
    def stalled(self) -> tuple[str, ...]:
        """Names of the frames of which an image is that of the frame before: a camera stalled, or files were copied.

        Where both did, the frame shows nothing new; where one did, its ranges are wrong by the motion since.
        """
        return tuple(
            frame.name
            for before, frame in pairwise(self.frames)
            if (frame.sha256 and frame.sha256 == before.sha256)
            or (frame.sha256_right and frame.sha256_right == before.sha256_right)
        )

    @cached_property
    def _by_name(self) -> dict[str, FinishedFrame]:
        return {frame.name: frame for frame in self.frames}


def settings_file(out: Path) -> Path:
    """Find the file that holds a run's settings. Raises InputError if ``out`` holds no run."""
    _run_content(out)
    return out / RUN


def open_run(out: Path) -> FinishedRun:
    """Read a run's folder, wherever it lies now and whether or not its inputs are still there.

    Raises InputError if ``out`` holds no run of this version of the program, or one that was killed before it could describe what
    it made; OutputError where its records or links lead out of it.
    """
    refuse_links_out(out)
    manifest = Manifest(out)
    content = _run_content(out)
    dive = manifest.dive()
    described = content["settings"]
    if any(dive.settings.get(stage) != settings for stage, settings in described.items()):
        raise InputError(
            f"{out}: a run with other settings was killed, or is under way, and {RUN} is of the run before: run the same line again"
        )
    order = {name: number for number, name in enumerate(content["frames"])}
    records = sorted(manifest.frames(), key=lambda record: (order.get(record.name, len(order)), record.name))
    last = "corrected" if "corrected" in dive.settings else "range"
    current = [record for record in records if dive.is_current(record, last)]  # type: ignore[arg-type]
    names = {record.name for record in current}
    geometry = content["geometry"]
    T = content["T_rectified_left"]
    return FinishedRun(
        root=out,
        config=content["config"],
        geometry=geometry,
        T_rectified_left=T,
        frames=tuple(_frame(out, record, dive, Path(content["working_directory"])) for record in current),
        state=dive.state,
        stale=tuple(record.name for record in records if record.name not in names and record.files),
        totals=content["totals"],
        inputs=content["inputs"],
        version=content["version"],
        made=content["date"],
        libraries=content["libraries"],
        command_line=tuple(content["command_line"]),
    )


def _frame(out: Path, record: FrameRecord, dive: DiveRecord, base: Path) -> FinishedFrame:
    stages = [stage for name, stage in record.stages.items() if dive.is_current(record, name)]
    source, right = record.inputs.get("left") or record.inputs.get("image"), record.inputs.get("right")
    return FinishedFrame(
        name=record.name,
        timestamp_s=record.timestamp_s,
        left=_found(Path(source.path), base) if source else Path(),
        sha256=source.sha256 if source else "",
        products={product: out / path for stage in stages for product, path in stage.outputs.items()},
        facts={key: value for stage in stages for key, value in stage.facts.items()},
        sha256_right=right.sha256 if right else "",
    )


def _found(given: Path, base: Path) -> Path:
    """An input from where it was given: relative to the run's working folder, or, where it is not there, to the present one."""
    return given if given.is_file() and not (base / given).is_file() else base / given


def _run_content(out: Path) -> dict[str, Any]:
    """run.json with its settings and geometry as objects."""
    path = out / RUN
    try:
        content = load_json(read_bytes(path))
    except (InputError, ValueError) as error:
        raise InputError(f"{out}: holds no finished run ({error})") from error
    if not isinstance(content, dict) or content.get("format") != RUN_FORMAT:
        raise InputError(f"{path}: is no {RUN} of this program (its format is not {RUN_FORMAT!r})")
    if content.get("format_version") != RUN_VERSION or not Manifest(out).exists():
        raise InputError(f"{path}: was written by another version of the program: run again into a new --out")
    try:
        described = vars(as_record(_Described, content))
        as_record(_Totals, described["totals"])
        return {**described, **_geometry(content), "config": RunConfig.model_validate(content["config"])}
    except (TypeError, KeyError, ValueError, AttributeError, CalibrationError) as error:
        raise InputError(f"{path}: is damaged: run again, which keeps what is finished") from error


def _geometry(content: dict[str, Any]) -> dict[str, Any]:
    if content["geometry"] is None:
        return {"geometry": None, "T_rectified_left": None}
    geometry = {**content["geometry"], "image_size": tuple(content["geometry"]["image_size"])}
    return {"geometry": RectifiedPair(**geometry), "T_rectified_left": np.array(content["T_rectified_left"], dtype=np.float64)}

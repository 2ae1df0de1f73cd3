"""A finished run read back: its settings, rig, frames and products, as the run recorded them."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from calibration import CalibrationError, RectifiedPair, StereoRig
from calibration.bounded_text import load_json
from calibration.formats import load_rig
from calibration.rig_errors import RangeError
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import RUN_FORMAT
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.json_records import as_record
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.records import Map, Numbers
from stereo_seecolor.run_folder.layout import FRAMES_TABLE, RIG, RUN, WATER, in_subfolder, page_path
from stereo_seecolor.run_folder.manifest import DiveRecord, FrameRecord, Manifest
from stereo_seecolor.run_folder.own_paths import refuse_links_out

RUN_VERSION = 2
YEAR_2000 = 946_684_800
LONGEST_RANGE_M = 1e4
"""Of a range: more is damage, as 0 is; what is unknown is NaN."""


@dataclass(frozen=True)
class FinishedFrame:
    """A pair that went through all stages.

    Attributes:
        name: Name of the frame and of its files.
        timestamp_s: Seconds, as the inputs give it; None without a time stamp.
        left: The raw left image as it was given, which may be gone since.
        sha256: Of the left image; "" where there is none.
        products: Product -> file in OUT.
        facts: The frame's numbers by column of frames.csv.
        sha256_right: Of the right image; "" where there is none.
        size: (width, height) of the products, by the run's geometry; None without one.
    """

    name: str
    timestamp_s: float | None
    left: Path
    sha256: str
    products: dict[str, Path]
    facts: dict[str, float] = field(default_factory=dict)
    sha256_right: str = ""
    size: tuple[int, int] | None = None

    @property
    def subfolder(self) -> str:
        """The folder in each product's folder that holds the frame's files; "" in a small dive."""
        corrected = self.products.get("corrected")
        name = corrected.parent.name if corrected else ""
        return name if name.isdecimal() else ""

    def page_path(self, product: str) -> str:
        """The path in OUT of one of the page's files of the frame, whether or not it exists."""
        return in_subfolder(page_path(product, self.name), self.subfolder)

    @property
    def taken(self) -> datetime | None:
        """The time of the frame in UTC; None without a time stamp, and for one before the year
        2000, which is a counter and no date.
        """
        stamp_s = self.timestamp_s or 0.0
        return datetime.fromtimestamp(stamp_s, UTC) if stamp_s > YEAR_2000 else None

    def read(self, product: str) -> NDArray[Any]:
        """Read the pixels of a product as they are stored.

        Args:
            product: Its name: ``corrected``, ``range``, ``range_std``, ``confidence``, ``mask``.

        Returns:
            (H, W), or (H, W, 3) RGB; the dtype of the file.

        Raises:
            InputError: If the product was not written, or is damaged.
        """
        path = self.products.get(product)
        if path is None:
            raise InputError(
                f"{self.name}: the run wrote no {product}: run again with it turned on"
            )
        try:
            # products in the left camera's own pixels have its size
            pixels = read_array(path, None if "/" in product else self.size)
        except InputError as error:
            raise InputError(
                f"{path}: is missing or damaged: run again, which makes it again"
            ) from error
        if problem := _problem(product, pixels):
            raise InputError(f"{path}: is damaged ({problem}): run again, which makes it again")
        return pixels

    def measured_range_m(self) -> Map:
        """Read the measured ranges, without filled-in ones.

        Returns:
            (H, W) float32, meters along the ray, NaN where nothing was measured.

        Raises:
            InputError: If the range map was not written, or is damaged.
        """
        confidence, range_m = self.read("confidence"), self.read("range")
        if confidence.shape != range_m.shape:
            raise InputError(
                f"{self.products['range']}: is of another size than {self.products['confidence']}: "
                "run again, which makes both again"
            )
        return np.where(confidence > 0, range_m, np.float32(np.nan))


def _problem(product: str, pixels: NDArray[Any]) -> str:
    """Why pixels are not those of a product: another image in its place; "" if they may be."""
    what = product.rpartition("/")[2]
    if what == "corrected":
        return "" if pixels.ndim == 2 or pixels.shape[2] == 3 else "has another number of channels"
    if pixels.ndim != 2 or (pixels.dtype.kind == "f") != what.startswith("range"):
        return "holds another kind of image"
    if what == "range" and ((pixels <= 0) | (pixels > LONGEST_RANGE_M)).any():
        return "contains invalid ranges"
    return ""


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
    range_error: RangeError | None = None


@dataclass(frozen=True)
class FinishedRun:
    """An output folder in its current state; ``open_run`` returns it.

    Attributes:
        root: The folder.
        config: The settings of the run.
        geometry: Of the rectified images; None for ``correct``, which has no calibration.
        T_rectified_left: (4, 4) float64, from the axes of the left camera as calibrated; None for
            ``correct``.
        frames: Frames that are finished and current, in the dive's order.
        state: Whether the latest run finished.
        stale: Names of frames whose products were made with earlier settings.
        unfinished: Names of frames that have some of their products, none made with earlier
            settings.
        totals: The numbers of the latest run's summary.
        inputs: The inputs of the run, by name.
        version: Of the program.
        made: When, as ISO 8601.
        libraries: Versions by name.
        command_line: The command line of the run.
        working_directory: From where it was run: relative paths of its inputs start there.
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
    unfinished: tuple[str, ...] = ()
    working_directory: Path = Path()

    @property
    def water_file(self) -> Path:
        """The file of the fitted water."""
        return self.root / WATER

    @property
    def range_error(self) -> RangeError | None:
        """The error of ranges by the check of the dive; None if it measured none."""
        return as_record(_Totals, self.totals).range_error

    @cached_property
    def rig(self) -> StereoRig:
        """The calibration as the run used it.

        Raises:
            InputError: For a run without calibration.
            CalibrationError: If its file is damaged.
        """
        geometry_of(self, "this")
        return load_rig(str(self.root / RIG))

    def frame(self, name: str) -> FinishedFrame:
        """Find a frame by its name.

        Args:
            name: Name of the frame.

        Returns:
            The frame.

        Raises:
            InputError: If the run has no frame of that name.
        """
        found = self._by_name.get(name)
        if found is None:
            raise InputError(
                f"{self.root}: holds no finished frame {name!r}: {FRAMES_TABLE} lists the status "
                "of each pair"
            )
        return found

    @cached_property
    def stalled(self) -> tuple[str, ...]:
        """Names of the frames of which an image is that of the frame before: a camera stalled, or
        files were copied.

        Where both did, the frame shows nothing new; where one did, ranges are wrong by the motion.
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


def open_run(out: str | Path) -> FinishedRun:
    """Read an output folder, also if it was moved or its inputs are missing.

    Args:
        out: The folder that was given as ``--out``.

    Returns:
        The run with its finished frames.

    Raises:
        InputError: If ``out`` contains no run of this version of the program, or a run that was
            killed before it wrote its description.
        OutputError: If its records or links lead out of it.
    """
    out = Path(out)
    refuse_links_out(out)
    manifest = Manifest(out)
    content = _run_content(out)
    dive = manifest.dive()
    described = content["settings"]
    if any(dive.settings.get(stage) != settings for stage, settings in described.items()):
        raise InputError(
            f"{out}: a run with other settings was killed, or is active, and {RUN} belongs to "
            "the previous run: run the same command again"
        )
    order = {name: number for number, name in enumerate(content["frames"])}
    records = sorted(
        manifest.frames(), key=lambda record: (order.get(record.name, len(order)), record.name)
    )
    last = "corrected" if "corrected" in dive.settings else "range"
    current = [record for record in records if dive.is_current(record, last)]  # type: ignore[arg-type]
    names = {record.name for record in current}
    others = [record for record in records if record.name not in names and record.files]
    geometry = content["geometry"]
    T = content["T_rectified_left"]
    return FinishedRun(
        root=out,
        config=content["config"],
        geometry=geometry,
        T_rectified_left=T,
        frames=tuple(
            _frame(out, record, dive, Path(content["working_directory"]), geometry)
            for record in current
        ),
        state=dive.state,
        stale=tuple(record.name for record in others if not _is_unfinished(record, dive)),
        unfinished=tuple(record.name for record in others if _is_unfinished(record, dive)),
        totals=content["totals"],
        inputs=content["inputs"],
        version=content["version"],
        made=content["date"],
        libraries=content["libraries"],
        command_line=tuple(content["command_line"]),
        working_directory=Path(content["working_directory"]),
    )


def totals_of(out: Path) -> dict[str, Any]:
    """The totals of a finished run, without the records of its frames; none where it cannot be
    read.
    """
    try:
        totals: dict[str, Any] = _run_content(out)["totals"]
    except InputError:
        return {}
    return totals


def wrong_numbers(totals: Mapping[str, Any]) -> frozenset[Numbers]:
    """The numbers of the dive as a whole that the run's checks found wrong."""
    kinds: tuple[Numbers, ...] = get_args(Numbers)
    return frozenset(kind for kind in kinds if totals.get(f"{kind}_are_wrong"))


def _is_unfinished(record: FrameRecord, dive: DiveRecord) -> bool:
    """Tell whether all that there is of a frame is of the latest settings."""
    return all(dive.is_current(record, stage) for stage in record.stages)


def _frame(
    out: Path, record: FrameRecord, dive: DiveRecord, base: Path, geometry: RectifiedPair | None
) -> FinishedFrame:
    stages = [stage for name, stage in record.stages.items() if dive.is_current(record, name)]
    source = record.inputs.get("left") or record.inputs.get("image")
    right = record.inputs.get("right")
    return FinishedFrame(
        name=record.name,
        timestamp_s=record.timestamp_s,
        left=_found(Path(source.path), base) if source else Path(),
        sha256=source.sha256 if source else "",
        products={
            product: out / path for stage in stages for product, path in stage.outputs.items()
        },
        facts={key: value for stage in stages for key, value in stage.facts.items()},
        sha256_right=right.sha256 if right else "",
        size=geometry.image_size if geometry else None,
    )


def _found(given: Path, base: Path) -> Path:
    """An input from where it was given: relative to the run's working folder, or to this one."""
    return given if given.is_file() and not (base / given).is_file() else base / given


def _run_content(out: Path) -> dict[str, Any]:
    """run.json with its settings and geometry as objects."""
    path = out / RUN
    try:
        content = load_json(read_bytes(path))
    except (InputError, ValueError) as error:
        raise InputError(f"{out}: holds no finished run ({error})") from error
    if not isinstance(content, dict) or content.get("format") != RUN_FORMAT:
        raise InputError(f"{path}: is not a run.json of this program, of format {RUN_FORMAT!r}")
    if content.get("format_version") != RUN_VERSION or not Manifest(out).exists():
        raise InputError(
            f"{path}: was written by another version of the program: run again into a new --out"
        )
    try:
        described = vars(as_record(_Described, content))
        as_record(_Totals, described["totals"])
        return {
            **described,
            **_geometry(content),
            "config": RunConfig.model_validate(content["config"]),
        }
    except (TypeError, KeyError, ValueError, AttributeError, CalibrationError) as error:
        if isinstance(error, ValidationError) and error.errors()[0]["type"] == "extra_forbidden":
            setting = ".".join(map(str, error.errors()[0]["loc"]))
            raise InputError(
                f"{path}: was written by another version of the program, with the setting "
                f"{setting!r}: run again"
            ) from error
        raise InputError(f"{path}: is damaged: run again, which keeps what is finished") from error


def geometry_of(run: FinishedRun, what: str) -> RectifiedPair:
    """The geometry of the rectified images, which ``what`` needs. Raises InputError."""
    if run.geometry is None:
        raise InputError(
            f"{run.root}: has no calibration (made by correct?): {what} needs the output of run"
        )
    return run.geometry


def geometry_of_ranges(folder: Path) -> RectifiedPair | None:
    """The geometry that the range maps of OUT/range were matched in; None for another folder."""
    folder = folder.resolve()
    if folder.name == "range":
        with suppress(InputError):
            return cast(RectifiedPair | None, _run_content(folder.parent)["geometry"])
    return None


def _geometry(content: dict[str, Any]) -> dict[str, Any]:
    if content["geometry"] is None:
        return {"geometry": None, "T_rectified_left": None}
    geometry: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in content["geometry"].items()
    }
    return {
        "geometry": RectifiedPair(**geometry),
        "T_rectified_left": np.array(content["T_rectified_left"], dtype=np.float64),
    }

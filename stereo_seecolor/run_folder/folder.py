"""The output folder of a run: where each thing lies, what is finished, and whose it is."""

import hashlib
import json
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, Self

from filelock import FileLock, Timeout

from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import remove_leftovers, write_atomic
from stereo_seecolor.files.encode import SUFFIX, ImageFormat

STATE = ".state"
RUN_FORMAT = "stereo-seecolor/run"
WHAT_IS_WHERE = {
    "corrected": "each left frame in its true colors, at its own bit depth",
    "range": "meters along the ray, float32 TIFF, NaN where unknown",
    "range_std": "standard error of the range, meters",
    "confidence": "0..255 for a confidence of 0..1 in the range",
    "mask": "1 range unknown, 2 range filled in, 3 color beyond recovery, 0 good",
    "clouds": "colored points in meters, left rectified camera, PLY",
    "rectified_left": "left images, rectified",
    "rectified_right": "right images, rectified",
    "rectified.yaml": "the calibration that the rectified images have",
    "map": "the fused map of the dive",
    "water.json": "the water that was fitted, for another run's --water",
    "water_measured.json": "the water measured from places seen at two ranges, for another run's --water",
    "frames.csv": "a row for each pair: status, warnings, shares, seconds a stage",
    "run.json": "the whole configuration, inputs with their hashes, totals",
}
PRODUCTS = tuple(name for name in WHAT_IS_WHERE if "." not in name)
FILES = tuple(name for name in WHAT_IS_WHERE if "." in name)


@dataclass(frozen=True)
class Finished:
    """What is known of a finished stage of a pair: enough to keep its outputs, or to tell that they are out of date.

    key: hash of all that the stage's outputs depend on. facts: columns of frames.csv.
    """

    key: str
    facts: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


class RunFolder:
    """OUT/, held by one run at a time.

    Use as a context manager: entering takes the lock, makes the folder and clears what a killed run left half written.
    Raises OutputError if it cannot be written, is held by another run, or holds something else.
    """

    def __init__(self, root: Path, identity: str, image_format: ImageFormat = "png", overwrite: bool = False) -> None:
        """identity: the dive this run belongs to (its inputs); a folder of another identity is refused unless overwrite."""
        self.root = root
        self._identity = identity
        self._image_suffix = SUFFIX[image_format]
        self._overwrite = overwrite
        self._hold = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as hold:
            hold.enter_context(held(self.root))
            self._claim()
            self._hold = hold.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._hold.close()

    def _claim(self) -> None:
        """Refuse what is not ours, begin anew if asked, and write down whose the folder is."""
        owner = self.root / STATE / "owner.json"
        foreign = [p.name for p in self.root.iterdir() if p.name not in (STATE, *PRODUCTS, *FILES)]
        if not owner.exists() and foreign:
            raise OutputError(f"{self.root}: holds other files ({foreign[0]}): choose another --out, an empty or a new folder")
        if owner.exists() and _read_json(owner).get("identity") != self._identity and not self._overwrite:
            raise OutputError(
                f"{self.root}: holds the results of another dive or command: choose another --out, or give --overwrite"
            )
        if self._overwrite:
            for product in (*PRODUCTS, f"{STATE}/range", f"{STATE}/corrected"):
                shutil.rmtree(self.root / product, ignore_errors=True)
            for name in FILES:
                (self.root / name).unlink(missing_ok=True)
        for folder in (self.root, *(path for path in self.root.rglob("*") if path.is_dir())):
            remove_leftovers(folder)
        write_atomic(owner, json.dumps({"identity": self._identity}).encode())

    def corrected(self, name: str) -> Path:
        """The frame in its true colors."""
        return self.root / "corrected" / f"{name}{self._image_suffix}"

    def range(self, name: str) -> Path:
        """float32 meters along the ray, NaN unknown."""
        return self.root / "range" / f"{name}.tiff"

    def range_std(self, name: str) -> Path:
        """float32 standard error of the range, meters."""
        return self.root / "range_std" / f"{name}.tiff"

    def confidence(self, name: str) -> Path:
        """8-bit, 255 = certain, 0 = unknown or filled in."""
        return self.root / "confidence" / f"{name}.png"

    def mask(self, name: str) -> Path:
        """8-bit codes of what cannot be relied on: see MASK_CODES in run_folder/products.py."""
        return self.root / "mask" / f"{name}.png"

    def cloud(self, name: str) -> Path:
        """The pair's colored points in the left rectified camera."""
        return self.root / "clouds" / f"{name}.ply"

    def rectified(self, side: str, name: str) -> Path:
        """A rectified image of one side, left or right."""
        return self.root / f"rectified_{side}" / f"{name}.png"

    def finished(self, stage: str, name: str, key: str, outputs: Iterable[Path] = ()) -> Finished | None:
        """What an earlier run finished of this pair's stage with the same key; None if it did not, or an output is gone."""
        path = self._state(stage, name)
        if not path.exists() or not all(output.exists() for output in outputs):
            return None
        content = _read_json(path)
        if content.get("key") != key:
            return None
        try:
            return Finished(key, dict(content["facts"]), tuple(content["warnings"]))
        except (KeyError, TypeError, ValueError):
            return None  # damaged: the outputs are made anew

    def finish(self, stage: str, name: str, finished: Finished) -> None:
        """Write down that all outputs of this pair's stage are there."""
        write_atomic(self._state(stage, name), json.dumps(asdict(finished)).encode())

    def write_json(self, name: str, content: Any) -> None:
        """Write one of the run's own files, such as run.json."""
        pieces = json.JSONEncoder(indent=2).iterencode(content)
        write_atomic(self.root / name, (piece.encode() for piece in chain(pieces, ["\n"])))

    def _state(self, stage: str, name: str) -> Path:
        return self.root / STATE / stage / f"{name}.json"


@contextmanager
def held(root: Path) -> Iterator[None]:
    """Hold a run's folder, made where it is missing: nothing else of ours writes into it meanwhile.

    Raises OutputError if it cannot be written, or is held already.
    """
    lock = FileLock(root / STATE / "lock", timeout=0)
    try:
        (root / STATE).mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise OutputError(f"{root}: another run is writing into it now: wait for it, or choose another --out") from error
    except OSError as error:
        raise OutputError(f"{root}: cannot be written: {error.strerror or error}: choose another --out") from error
    try:
        yield
    finally:
        lock.release()


def content_key(*parts: object) -> str:
    """A hash of everything that an output depends on; equal parts give equal keys, on any machine."""
    digest = hashlib.sha256()
    for part in parts:
        content = part if isinstance(part, bytes) else json.dumps(part, sort_keys=True, default=str).encode()
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}

"""A finished run folder, read back one frame at a time for the map."""

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.run_folder.folder import RUN_FORMAT
from stereo_seecolor.run_folder.products import MASK_CODES


class SurveyFrames(Lazy[SurveyFrame]):
    """The frames of ``OUT/`` that went through all stages, in the order of their names; each is read when asked for.

    pair: the geometry of the rectified images. T_rectified_left: (4, 4), from the raw left camera's axes.
    Raises InputError if OUT/ holds no finished run with ranges and colors.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        content = _run_content(out)
        if content.get("geometry") is None:
            raise InputError(f"{out / 'run.json'}: knows nothing of the camera (made by correct?): a map needs the output of run")
        try:
            self.pair = RectifiedPair(**{**content["geometry"], "image_size": tuple(content["geometry"]["image_size"])})
            self.T_rectified_left = np.array(content["T_rectified_left"])
        except (TypeError, KeyError) as error:
            raise InputError(
                f"{out / 'run.json'}: damaged, or of another version: run again, which keeps what is finished"
            ) from error
        self._rows = [row for row in _rows(out) if row["status"] == "ok"]
        if not self._rows:
            raise InputError(f"{out}: holds no frame that went through all stages")

    def __len__(self) -> int:
        return len(self._rows)

    def item(self, number: int) -> SurveyFrame:
        """Read one frame. Raises FrameError if one of its files is gone or damaged."""
        row = self._rows[number]
        try:
            return self._frame(row)
        except InputError as error:
            raise FrameError(row["name"], str(error)) from error

    def _frame(self, row: dict[str, str]) -> SurveyFrame:
        name = row["name"]
        confidence = self._read(self._out / "confidence" / f"{name}.png")
        measured = confidence > 0
        range_m = np.where(measured, self._read(self._out / "range" / f"{name}.tiff"), np.float32(np.nan))
        return SurveyFrame(
            name=name,
            timestamp_s=float(row["timestamp_s"]) if row["timestamp_s"] else None,
            color=self._color(name),
            range_m=range_m,
            range_std_m=self._read(self._out / "range_std" / f"{name}.tiff"),
            confidence=(confidence / np.float32(255)).astype(np.float32),
            unrecoverable=self._read(self._out / "mask" / f"{name}.png") == MASK_CODES["color beyond recovery"],
        )

    def _color(self, name: str) -> NDArray[np.uint8]:
        path = next(
            (p for p in (self._out / "corrected" / f"{name}{suffix}" for suffix in (".png", ".jpg", ".tiff")) if p.exists()), None
        )
        if path is None:
            raise InputError(f"{self._out / 'corrected' / name}: is gone; run again to make it anew")
        image = self._read(path)
        if image.dtype == np.uint16:
            image = image >> 8
        elif image.dtype == np.float32:
            raise InputError(f"{path}: is linear and unclipped; a map needs output.image_format=png, png16 or jpg")
        rgb: NDArray[np.uint8] = cv2.cvtColor(image.astype(np.uint8), cv2.COLOR_BGR2RGB)
        return rgb

    def _read(self, path: Path) -> NDArray[Any]:
        image: NDArray[Any] | None = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cut_short = path.suffix == ".jpg" and image is not None and not path.read_bytes().endswith(b"\xff\xd9")
        if image is None or cut_short or image.shape[1::-1] != self.pair.image_size:
            raise InputError(f"{path}: is gone or damaged; run again to make it anew")
        return image


def _run_content(out: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads((out / "run.json").read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{out}: holds no finished run (run.json cannot be read: {error})") from error
    if not isinstance(content, dict) or content.get("format") != RUN_FORMAT:
        raise InputError(f"{out / 'run.json'}: is no run.json of this program (its format is not {RUN_FORMAT!r})")
    return content


def _rows(out: Path) -> list[dict[str, str]]:
    try:
        rows = list(csv.DictReader((out / "frames.csv").read_text(encoding="utf-8").splitlines()))
    except (OSError, ValueError) as error:
        raise InputError(f"{out / 'frames.csv'}: cannot be read: {error}") from error
    if rows and not {"name", "status", "timestamp_s"} <= rows[0].keys():
        raise InputError(f"{out / 'frames.csv'}: damaged: run again, which keeps what is finished")
    return rows

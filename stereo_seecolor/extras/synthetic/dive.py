"""A whole synthetic dive on disk: what a vehicle would bring home, and beside it the truth."""

import json
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.bounded_text import load_json
from calibration.formats import native
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.synthetic.reef import CELL_M, Reef
from stereo_seecolor.extras.synthetic.render import RenderedPair, Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.extras.synthetic.waters import WATER_NAMES
from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.free_places import refuse_filled
from stereo_seecolor.files.json_records import load_object
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.progress import Listener, Silence
from stereo_seecolor.records import FrameRow, Water

_FOLDERS = {
    "left": ".png",
    "right": ".png",
    "truth/color": ".png",
    "truth/range": ".tiff",
    "truth/visible": ".png",
}
_SPEC = Path("truth/water.json")
"""Written first: it tells whether a folder holds the same survey."""
_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 9, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_FILTERED]
# deflate, floating point
_FLOAT_TIFF = [cv2.IMWRITE_TIFF_COMPRESSION, 8, cv2.IMWRITE_TIFF_PREDICTOR, 3]
_RANGE_STEPS_PER_M = 4096
"""Ranges are rounded to 0.24 mm, a tenth of what stereo can tell here, so that they compress."""


def synthesize(spec: SurveySpec, out: Path, listener: Listener | None = None) -> None:
    """Render the survey into ``out``; docs/synthetic.md lists the files.

    Files that are there are kept, so a stopped survey continues. Raises OutputError if the folder
    cannot be written, or holds anything but the same survey.
    """
    listener = listener or Silence()
    listener.begin("render", spec.pairs)
    _refuse_other(spec, out)
    scene = Scene.from_spec(spec)
    water = json.dumps(_water_content(scene), indent=1) + "\n"
    _keep_or_write(out / _SPEC, lambda path: path.write_text(water, encoding="utf-8"))
    _keep_or_write(out / "cam.yaml", lambda path: native.write(scene.rig, path))
    _keep_or_write(
        out / "trajectory.tum",
        lambda path: write_tum(path, replace(scene.trajectory, names=("",) * spec.pairs)),
    )
    _keep_or_write(out / "truth/surface.npz", lambda path: _write_surface(path, scene.reef))
    for index, name in enumerate(scene.trajectory.names):
        if not all(file.is_file() for file in _pair_files(out, name)):
            _write_pair(out, scene.render(index))
        listener.advance(FrameRow(f"pair {index + 1}"))


def parse_spec(pairs: int, lines: int, size: str, water: str, seed: int) -> SurveySpec:
    """A specification from what a command line gives.

    Raises InputError for a size that is none, an unknown water, or more lines than pairs.
    """
    width, _, height = size.partition("x")
    if not (width.isdecimal() and height.isdecimal() and min(int(width), int(height)) >= 64):
        raise InputError(
            f"--size {size}: write it as WIDTHxHEIGHT in pixels, at least 64x64, for example "
            "640x512"
        )
    if water not in WATER_NAMES:
        raise InputError(f"--water {water}: there are {', '.join(WATER_NAMES)}")
    if lines > pairs:
        raise InputError(f"--lines {lines}: more lines than the {pairs} pairs")
    named = next(name for name in WATER_NAMES if name == water)
    return SurveySpec(
        seed=seed, pairs=pairs, lines=lines, image_size=(int(width), int(height)), water=named
    )


def _refuse_other(spec: SurveySpec, out: Path) -> None:
    """Raises OutputError if ``out`` holds anything but files of this very survey: they may be
    somebody's dive.
    """
    try:
        same = load_object(out / _SPEC)["survey"] == load_json(json.dumps(asdict(spec)))
    except (OSError, ValueError, LookupError, TypeError):
        same = False
    if not same:
        refuse_filled(out)


def _pair_files(out: Path, name: str) -> list[Path]:
    return [out / folder / f"{name}{suffix}" for folder, suffix in _FOLDERS.items()]


def _write_pair(out: Path, pair: RenderedPair) -> None:
    range_m = np.round(pair.range_map.range_m * _RANGE_STEPS_PER_M) / np.float32(_RANGE_STEPS_PER_M)
    visible = (pair.visible & ~pair.moving).astype(np.uint8) * 255
    images = [
        cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
        for rgb in (pair.frame.left, pair.frame.right, pair.color_image)
    ]
    for path, pixels in zip(
        _pair_files(out, pair.frame.name),
        [*images, range_m.astype(np.float32), visible],
        strict=True,
    ):
        _, content = cv2.imencode(
            path.suffix, pixels, _FLOAT_TIFF if path.suffix == ".tiff" else _PNG
        )
        _keep_or_write(path, partial(Path.write_bytes, data=content.tobytes()))


def _keep_or_write(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file that is not there yet, as a whole or not at all."""
    if not path.is_file():
        with atomic_path(path) as temporary:
            write(temporary)


def _water_content(scene: Scene) -> dict[str, Any]:
    """As OUT/water.json, with what else is true of the light, and the specification."""
    values = {field.name: getattr(scene.water.water, field.name) for field in fields(Water)}
    return {
        "format": "stereo-seecolor/water",
        "version": 1,
        "water": {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in values.items()
        },
        "sun_attenuation": scene.water.sun_attenuation.tolist(),
        "white_at_depth_m": scene.water.depth_m,
        "chart_corners_m": scene.reef.chart_corners_m.round(6).tolist(),
        "survey": asdict(scene.spec),
    }


def _write_surface(path: Path, reef: Reef) -> None:
    """The ground at 1 cm: height_m (ny, nx), up; origin_m (x, y) of the first cell; cell_m."""
    height_m = np.round(reef.height_m[::2, ::2] * 4096) / 4096
    np.savez_compressed(
        path,
        height_m=height_m.astype(np.float32),
        origin_m=np.array(reef.origin_m),
        cell_m=np.array(2 * CELL_M),
    )

"""A whole synthetic dive on disk: what a vehicle would bring home, and beside it the truth."""

import json
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.formats import native
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.records import Water
from stereo_seecolor.synthetic.reef import CELL_M, Reef
from stereo_seecolor.synthetic.render import RenderedPair, Scene
from stereo_seecolor.synthetic.survey import SurveySpec
from stereo_seecolor.synthetic.waters import WATER_NAMES

_FOLDERS = ("left", "right", "truth/range", "truth/color", "truth/visible")
_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 9, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_FILTERED]
_FLOAT_TIFF = [cv2.IMWRITE_TIFF_COMPRESSION, 8, cv2.IMWRITE_TIFF_PREDICTOR, 3]  # deflate, floating point
_RANGE_STEPS_PER_M = 4096
"""Ranges are rounded to 0.24 mm, a tenth of what stereo can tell here, so that they compress."""


def synthesize(spec: SurveySpec, out: Path, done: Callable[[int, int], None] = lambda finished, pairs: None) -> None:
    """Render the survey into ``out``; docs/synthetic.md lists the files. ``done(finished, pairs)`` is called after each pair.

    Raises OutputError if the folder cannot be written.
    """
    scene = Scene.from_spec(spec)
    try:
        for folder in _FOLDERS:
            (out / folder).mkdir(parents=True, exist_ok=True)
        native.write(scene.rig, out / "cam.yaml")
        write_tum(out / "trajectory.tum", replace(scene.trajectory, names=("",) * spec.pairs))
        (out / "truth/water.json").write_text(json.dumps(_water_content(scene), indent=1) + "\n", encoding="utf-8")
        _write_surface(out / "truth/surface.npz", scene.reef)
        for index in range(spec.pairs):
            _write_pair(out, scene.render(index))
            done(index + 1, spec.pairs)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error.strerror or error}: give another folder") from error


def parse_spec(pairs: int, lines: int, size: str, water: str, seed: int) -> SurveySpec:
    """A specification from what a command line gives.

    Raises InputError for a size that is none, an unknown water, or more lines than pairs.
    """
    width, _, height = size.partition("x")
    if not (width.isdecimal() and height.isdecimal() and min(int(width), int(height)) >= 64):
        raise InputError(f"--size {size}: write it as WIDTHxHEIGHT in pixels, at least 64x64, for example 640x512")
    if water not in WATER_NAMES:
        raise InputError(f"--water {water}: there are {', '.join(WATER_NAMES)}")
    if lines > pairs:
        raise InputError(f"--lines {lines}: more lines than the {pairs} pairs")
    named = next(name for name in WATER_NAMES if name == water)
    return SurveySpec(seed=seed, pairs=pairs, lines=lines, image_size=(int(width), int(height)), water=named)


def _write_pair(out: Path, pair: RenderedPair) -> None:
    name = pair.frame.name
    _write_image(out / "left" / f"{name}.png", pair.frame.left)
    _write_image(out / "right" / f"{name}.png", pair.frame.right)
    _write_image(out / "truth/color" / f"{name}.png", pair.color_image)
    _write(out / "truth/visible" / f"{name}.png", (pair.visible & ~pair.moving).astype(np.uint8) * 255, _PNG)
    range_m = np.round(pair.range_map.range_m * _RANGE_STEPS_PER_M) / np.float32(_RANGE_STEPS_PER_M)
    _write(out / "truth/range" / f"{name}.tiff", range_m.astype(np.float32), _FLOAT_TIFF)


def _write_image(path: Path, rgb: NDArray[Any]) -> None:
    _write(path, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), _PNG)


def _write(path: Path, pixels: NDArray[Any], parameters: list[int]) -> None:
    _, content = cv2.imencode(path.suffix, pixels, parameters)
    path.write_bytes(content.tobytes())


def _water_content(scene: Scene) -> dict[str, Any]:
    """As OUT/water.json, with what else is true of the light, and the specification that made it all."""
    values = {field.name: getattr(scene.water.water, field.name) for field in fields(Water)}
    return {
        "format": "stereo-seecolor/water",
        "version": 1,
        "water": {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()},
        "sun_attenuation": scene.water.sun_attenuation.tolist(),
        "white_at_depth_m": scene.water.depth_m,
        "chart_corners_m": scene.reef.chart_corners_m.round(6).tolist(),
        "survey": asdict(scene.spec),
    }


def _write_surface(path: Path, reef: Reef) -> None:
    """The ground itself at 1 cm: height_m (ny, nx), up; origin_m (x, y) of its first row and column; cell_m."""
    height_m = np.round(reef.height_m[::2, ::2] * 4096) / 4096
    np.savez_compressed(path, height_m=height_m.astype(np.float32), origin_m=np.array(reef.origin_m), cell_m=np.array(2 * CELL_M))

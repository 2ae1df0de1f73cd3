"""water.json: the water that was fitted, with its standard errors; can be given back to another run with --water."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.records import Water

FORMAT = "stereo-seecolor/water"
VERSION = 1


def water_content(water: Water) -> dict[str, Any]:
    """A water as JSON holds it: lists in the order R, G, B; null for what is not known."""
    return {field.name: _plain(getattr(water, field.name)) for field in fields(Water)}


def write_waters(path: Path, waters: Mapping[str, Water]) -> None:
    """Write one water for all frames if they share it, else each frame's under its name. Raises OutputError."""
    write_atomic(path, waters_content(waters))


def waters_content(waters: Mapping[str, Water]) -> bytes:
    """The content of a water.json: one water for all frames if they share it, else each frame's under its name."""
    first = water_content(next(iter(waters.values()))) if waters else None
    shared = first is not None and all(water_content(water) == first for water in set(waters.values()))
    body = {"water": first} if shared else {"frames": {name: water_content(water) for name, water in waters.items()}}
    return (json.dumps({"format": FORMAT, "version": VERSION, **body}, indent=1, allow_nan=False) + "\n").encode()


def read_waters(path: Path, names: Sequence[str]) -> dict[str, Water]:
    """The water of each of ``names``: the file's one water, or each frame's own.

    Raises InputError if the file is no water.json, or holds waters of single frames and one of ``names`` is not among them.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT or content.get("version") != VERSION:
        raise InputError(f"{path}: is no {FORMAT} version {VERSION} file: give the water.json of an earlier run")
    if "water" in content:
        water = _water(content["water"], path)
        return dict.fromkeys(names, water)
    frames = content.get("frames")
    frames = frames if isinstance(frames, dict) else {}
    missing = [name for name in names if name not in frames]
    if missing:
        raise InputError(f"{path}: holds each frame's own water, and none for {missing[0]!r}: fit it with color.lock=survey")
    return {name: _water(frames[name], path) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [float(v) if np.isfinite(v) else None for v in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def _water(content: Any, path: Path) -> Water:
    try:
        values = dict(content)
        errors = {key: _channels(value) for key, value in values.pop("standard_errors", {}).items()}
        warnings = tuple(str(warning) for warning in values.pop("warnings", ()))
        values = {key: _channels(value) if isinstance(value, list) else value for key, value in values.items()}
        water = Water(**values, standard_errors=errors, warnings=warnings)
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: is damaged: {error}") from error
    rates = [water.gamma_inf, water.beta, water.eta, water.alpha, water.w, water.v, water.y, water.x, water.white]
    if not all(isinstance(rate, np.ndarray) and rate.shape == (3,) and np.isfinite(rate).all() for rate in rates):
        raise InputError(f"{path}: is damaged: each parameter needs three finite numbers, one a channel")
    return water


def _channels(value: Any) -> Any:
    return np.array([np.nan if item is None else float(item) for item in value], dtype=np.float64)

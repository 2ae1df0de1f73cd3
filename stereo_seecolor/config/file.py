"""Reads settings from a file and ``--set``, in that order; with the origin of every value."""

import difflib
import re
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from calibration.bounded_text import YAML_ERRORS, SingleKeys, TooMuchError, load_json, load_yaml
from stereo_seecolor.config import RobustConfig, RunConfig
from stereo_seecolor.errors import ConfigError, InputError
from stereo_seecolor.files.text_documents import read_text, yaml_problem
from stereo_seecolor.plugins import added

RUN_FORMAT = "stereo-seecolor/run"
"""The "format" of a run.json, whose "config" is a configuration too."""

_Content = dict[str, Any]

RENAMED = {
    "color.objective": "it is now color.method: objective=robust is method=robust, "
    "objective=paper is method=paper",
    "color.solver": "it is now color.method: solver=dense is method=paper, solver=table is "
    "method=robust or paper",
    **dict.fromkeys(
        ("color.clipped_fraction", "color.clipped_share"),
        "brightness is now set by color.median_luminance",
    ),
    **{f"color.{key}": f"it is now color.robust.{key}" for key in RobustConfig.model_fields},
    "color.first_steps": "it is now color.paper.iterations",
    "color.next_steps": "it is now color.paper.iterations_per_frame",
    "color.paper_adam": "its settings are now color.paper.iterations and iterations_per_frame",
    **dict.fromkeys(
        ("color.robust.scene_colors", "color.scene_colors"),
        "scene_colors=gray is now color.robust.white_point=gray",
    ),
    **dict.fromkeys(("color.device", "matching.device"), "it is now device, or --device"),
    **dict.fromkeys(
        (
            *("color.penalty", "color.paper.penalty"),
            *("color.learning_rate", "color.paper.learning_rate"),
        ),
        "it is fixed (docs/lab/theory.md)",
    ),
    "input.video_every": "it is now input.video_step",
    "input.video_overlap": "it is now input.video_step, a number below 1",
    "color.sliding_frames": "it is now the number that color.lock takes: color.lock=20",
    "color.highlights": "highlights are always rolled off; output.image_format=tiff32 is linear",
    "output.compression": "files are always compressed fast; output.preset=lean deflates range "
    "maps",
    "output.range_std": "standard errors of ranges are always written; output.preset=lean rounds "
    "them",
    "output.clouds": "it is now output.preset=no-clouds",
    **dict.fromkeys(
        ("color.input_noise", "color.output_noise"),
        "gains stop where noise of 1.5 of 255 would pass 0.06 of full scale",
    ),
    **dict.fromkeys(
        ("color.robust.attenuation", "color.attenuation"), "attenuation always varies with range"
    ),
    **dict.fromkeys(
        ("color.robust.water_depth_m", "color.water_depth_m"),
        "the light at the reef is fitted with the water (color.robust.white_point)",
    ),
    "matching.model": "it is now matching.engine=NET.onnx",
    "measuring": "the error of lengths follows from the calibration's own standard errors; "
    "mapping.markers.bars scales a map by bars of known length",
    "mapping.loop_closure": "loops are always closed where GTSAM is installed",
    "mapping.bundle_adjustment": "bundle adjustment always runs where GTSAM is installed",
    **dict.fromkeys(
        (f"mapping.mount.{key}" for key in ("surge_m", "sway_m", "heave_m")),
        "it is now mapping.mount.xyz_m=[surge, sway, heave]",
    ),
    **dict.fromkeys(
        (f"mapping.mount.{key}" for key in ("roll_deg", "pitch_deg", "yaw_deg")),
        "it is now mapping.mount.rpy_deg=[roll, pitch, yaw]",
    ),
    "mapping.max_gap_s": "poses are always interpolated across gaps of at most 5 s",
    "mapping.max_speed_m_s": "a step faster than 3 m/s and than three times the usual speed is a "
    "jump",
    **dict.fromkeys(
        ("mapping.prior_depth_std_m", "mapping.prior_attitude_std_deg"),
        "it is always estimated from the dive",
    ),
}
"""Settings of earlier versions -> what has replaced them."""


class _SettingsLoader(SingleKeys):
    """YAML 1.1 as PyYAML reads it, and 1e-3 is a number as in YAML 1.2."""


_SettingsLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


@dataclass(frozen=True)
class Setting:
    """One setting of a merged configuration. origin: "default", the file's path, or "--set"."""

    key: str
    value: Any
    default: Any
    origin: str
    description: str


@dataclass(frozen=True)
class _Layer:
    origin: str
    content: _Content


ADDED = {
    "matching.engine": ("matching_engines", ("sgm", "opencv", "an .onnx file")),
    "mapping.engine": ("engines", ("tiles",)),
    "color.method": ("color_methods", ("robust", "paper")),
}
"""Setting -> the group in which packages add engines or methods, and the program's own."""


def load_config(path: str | Path | None = None, overrides: Sequence[str] = ()) -> RunConfig:
    """Return the defaults, changed by a file and then by ``section.key=value`` overrides; the last
    wins.

    Args:
        path: A YAML file, or the run.json of an earlier run.
        overrides: ``section.key=value``, the value as YAML. A mapping sets the keys that it names
            and leaves the others: ``mapping.markers={edge_m: 0.1, family: 25h9}``.

    Returns:
        All settings.

    Raises:
        ConfigError: For an unreadable file, an unknown key (the message suggests the most similar
            known one), or a bad value.
    """
    return _validated(_layers(None if path is None else Path(path), overrides))


def load_settings(path: Path | None = None, overrides: Sequence[str] = ()) -> tuple[Setting, ...]:
    """Every setting of ``load_config`` with the origin of its value. Raises ConfigError."""
    layers = _layers(path, overrides)
    values, defaults = flat(_validated(layers).model_dump()), flat(RunConfig().model_dump())
    return tuple(
        Setting(
            key,
            values[key],
            defaults[key],
            _origin(layers, key.split(".")) or "default",
            description,
        )
        for key, description in descriptions().items()
    )


def known_keys() -> list[str]:
    """Every ``section.key`` that holds a value."""
    return list(descriptions())


def descriptions(model: type[BaseModel] = RunConfig, prefix: str = "") -> dict[str, str]:
    """Every ``section.key`` of a model that holds a value, with its description."""
    found: dict[str, str] = {}
    for name, field in model.model_fields.items():
        if isinstance(field.default, BaseModel):
            found |= descriptions(type(field.default), f"{prefix}{name}.")
        else:
            found[prefix + name] = field.description or ""
    return found


def _layers(path: Path | None, overrides: Sequence[str]) -> list[_Layer]:
    from_file = [_Layer(str(path), _read(path))] if path else []
    return from_file + [_Layer("--set", _override(text)) for text in overrides]


def _validated(layers: Sequence[_Layer]) -> RunConfig:
    merged: _Content = {}
    for layer in layers:
        merged = _merge(merged, layer.content)
    try:
        config = RunConfig.model_validate(merged)
    except ValidationError as error:
        raise ConfigError(_first_problem(error, layers)) from error
    for key, (group, own) in ADDED.items():
        section, name = key.split(".")
        _check_added(
            getattr(getattr(config, section), name),
            group,
            own,
            f"{_origin(layers, [section, name])}: {key}",
        )
    return config


def _check_added(chosen: str | Path, group: str, own: Sequence[str], where: str) -> None:
    """Raise ConfigError for an engine or a method that is neither the program's own nor added by a
    package; a run of another machine that had it can still be read.
    """
    if not isinstance(chosen, Path) and chosen not in own and chosen not in added(group):
        known = [*own, *sorted(added(group).keys() - set(own))]
        what = where.rpartition(".")[2]
        raise ConfigError(
            f"{where}: no installed package adds this {what}; known are {', '.join(known)} (got "
            f"{chosen!r})"
        )


def _merge(base: _Content, over: _Content) -> _Content:
    """Two contents merged: mappings key by key; other values of ``over`` replace ``base``'s."""
    both = {
        key: _merge(base[key], over[key])
        for key in base.keys() & over.keys()
        if isinstance(base[key], dict) and isinstance(over[key], dict)
    }
    return {**base, **over, **both}


def _read(path: Path) -> _Content:
    try:
        content = _parsed(read_text(path))
    except InputError as error:
        raise ConfigError(str(error)) from error
    except YAML_ERRORS as error:
        raise ConfigError(f"{path}: {yaml_problem(error)}") from error
    if isinstance(content, dict) and content.get("format") == RUN_FORMAT:
        content = content.get("config")
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ConfigError(
            f"{path}: must hold sections ({', '.join(RunConfig.model_fields)}), got a "
            f"{type(content).__name__}"
        )
    return _with_sections(content, RunConfig)


def _with_sections(content: _Content, model: type[BaseModel]) -> _Content:
    """Sections of which no line is left, or only comments, are empty."""
    models = {
        name: type(field.default)
        for name, field in model.model_fields.items()
        if isinstance(field.default, BaseModel)
    }
    return {
        name: _with_sections(value or {}, models[name])
        if name in models and (value is None or isinstance(value, dict))
        else value
        for name, value in content.items()
    }


def _parsed(text: str) -> Any:
    """The content of JSON or YAML. JSON first: run.json of a long dive takes minutes as YAML."""
    try:
        return load_json(text)
    except TooMuchError:
        raise
    except ValueError:
        return load_yaml(text, _SettingsLoader)


def _override(text: str) -> _Content:
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or (key not in RunConfig.model_fields and "." not in key):
        raise ConfigError(
            f"--set {text}: write it as section.key=value, for example color.lock=survey"
        )
    if not any(known == key or known.startswith(f"{key}.") for known in known_keys()):
        raise ConfigError(f"--set {text}: there is no setting {key!r}{_suggestion(key)}")
    try:
        content = load_yaml(value, _SettingsLoader)
    except YAML_ERRORS as error:
        raise ConfigError(
            f"--set {text}: the value cannot be read: {' '.join(str(error).split())}"
        ) from error
    for name in reversed(key.split(".")):
        content = {name: content}
    return dict(content)


def flat(content: _Content, prefix: str = "") -> _Content:
    """Every ``section.key`` with its value."""
    found: _Content = {}
    for name, value in content.items():
        found |= (
            flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
        )
    return found


def _origin(layers: Sequence[_Layer], key: Sequence[str]) -> str | None:
    """The origin of the last layer that holds the key, or overwrites a section of it; or None."""
    return next((layer.origin for layer in reversed(layers) if _holds(layer.content, key)), None)


def _holds(content: object, key: Sequence[str]) -> bool:
    if not key or not isinstance(content, dict):
        return True
    return key[0] in content and _holds(content[key[0]], key[1:])


def _suggestion(key: str) -> str:
    if renamed := next(
        (RENAMED[old] for old in RENAMED if key == old or key.startswith(f"{old}.")), ""
    ):
        return f"; {renamed}"
    near = difflib.get_close_matches(key, [*known_keys(), *RunConfig.model_fields], n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known_keys())}"


def _first_problem(error: ValidationError, layers: Sequence[_Layer]) -> str:
    problem = error.errors()[0]
    parts = [str(part) for part in problem["loc"]]
    where = _origin(layers, parts) or layers[-1].origin
    if problem["type"] == "extra_forbidden":
        key = ".".join(parts)
        if parts != key.split("."):
            return (
                f"{where}: {key}: write its parts on lines of their own, each below the one before"
            )
        return f"{where}: there is no setting {key!r}{_suggestion(key)}"
    key = next(
        (known for known in known_keys() if known.split(".") == parts[: known.count(".") + 1]),
        ".".join(parts),
    )
    message = problem["msg"].removeprefix("Value error, ")
    return (
        f"{where}: {key}: {message[0].lower()}{message[1:]} (got {reprlib.repr(problem['input'])})"
    )

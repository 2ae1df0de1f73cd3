"""The native ``cam.yaml``: one versioned file for a rig, in meters, with its conventions."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import NATIVE
from calibration.formats.reading.document import load_document
from calibration.formats.reading.section import Section, naming
from calibration.port import DomePort, FlatPort, FlatWindow, Port, seawater_index
from calibration.refinement import UNSEEN, Movement, Refinement
from calibration.rig import Camera, CameraModel, Medium, StereoRig
from calibration.rig_errors import RigErrors

VERSION = 1


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _CameraModel(_Strict):
    model: CameraModel = "pinhole"
    image_size: tuple[int, int]
    K: list[list[float]]
    distortion: list[float] = Field(default_factory=list)


class _WaterModel(_Strict):
    temperature_c: float
    salinity_psu: float
    depth_m: float = 0.0
    wavelength_nm: float = 530.0


class _WindowModel(_Strict):
    distance_mm: float
    thickness_mm: float
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)


class _FlatPortModel(_Strict):
    type: Literal["flat"]
    working_range_m: float
    water: _WaterModel | None = None
    water_index: float | None = None
    glass_index: float = 1.49
    left: _WindowModel
    right: _WindowModel


class _DomePortModel(_Strict):
    type: Literal["dome"]


class _MovementModel(_Strict):
    name: str
    value: float
    std: float


class _RefinedModel(_Strict):
    """What has moved: radians, or a relative scale; cameras and T_right_left already contain it."""

    movements: list[_MovementModel]
    before_px: float
    after_px: float
    pairs: int
    matches: int
    focal_px: float
    not_seen: str = UNSEEN


class _ErrorsModel(_Strict):
    """Standard errors of focal length and baseline, relative."""

    focal: float = Field(ge=0)
    baseline: float = Field(ge=0)
    stated_by: str


class _RigModel(_Strict):
    format: Literal["stereo-seecolor/rig"]
    version: Literal[1]
    medium: Medium = "water"
    rms_px: float | None = None
    left: _CameraModel
    right: _CameraModel
    T_right_left: list[list[float]]
    port: Annotated[_FlatPortModel | _DomePortModel, Field(discriminator="type")] | None = None
    refined: _RefinedModel | None = None
    errors: _ErrorsModel | None = None


def read(path: Path) -> StereoRig:
    """Read a native rig file.

    Raises CalibrationError, naming the file, the key and the value, if it is not YAML, misses a
    key, or is not a rig.
    """
    with naming(str(path)):
        return parse(load_document(path))


def matches(document: Section) -> bool:
    """True for a native rig file, of any version."""
    return document.content.get("format") == NATIVE


def parse(document: Section) -> StereoRig:
    """The rig of a native file."""
    try:
        return _to_rig(_RigModel.model_validate(document.content))
    except ValidationError as error:
        raise CalibrationError(_first_problem(error)) from error
    except CalibrationError:
        raise
    except ValueError as error:
        raise CalibrationError(f"rows of a matrix differ in length: {error}") from error


def write(rig: StereoRig, path: Path) -> None:
    """Write ``rig`` so that ``read`` gives back the same numbers exactly."""
    path.write_bytes(to_bytes(rig))


def to_bytes(rig: StereoRig) -> bytes:
    """The bytes of a native rig file."""
    return yaml.safe_dump(to_content(rig), sort_keys=False, default_flow_style=None).encode()


def to_content(rig: StereoRig) -> dict[str, Any]:
    """The content of a native rig file, from which ``parse`` makes the same numbers exactly."""
    content: dict[str, Any] = {
        "format": NATIVE,
        "version": VERSION,
        "medium": rig.medium,
        "rms_px": rig.rms_px,
        "left": _camera_content(rig.left),
        "right": _camera_content(rig.right),
        "T_right_left": rig.T_right_left.tolist(),
    }
    if rig.port is not None:
        content["port"] = _port_content(rig.port)
    if rig.refinement is not None:
        content["refined"] = {**asdict(rig.refinement), "not_seen": UNSEEN}
        content["refined"]["movements"] = [
            asdict(movement) for movement in rig.refinement.movements
        ]
    if rig.errors is not None:
        content["errors"] = asdict(rig.errors)
    return content


def _camera_content(camera: Camera) -> dict[str, Any]:
    return {
        "model": camera.model,
        "image_size": list(camera.image_size),
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
    }


def _to_rig(content: _RigModel) -> StereoRig:
    return StereoRig(
        left=_to_camera(content.left, "left"),
        right=_to_camera(content.right, "right"),
        T_right_left=np.array(content.T_right_left, dtype=np.float64),
        medium=content.medium,
        rms_px=content.rms_px,
        port=_to_port(content.port),
        refinement=_to_refinement(content.refined),
        errors=RigErrors(**content.errors.model_dump()) if content.errors else None,
    )


def _to_refinement(content: _RefinedModel | None) -> Refinement | None:
    if content is None:
        return None
    figures = content.model_dump(exclude={"movements", "not_seen"})
    return Refinement(
        movements=tuple(Movement(**movement.model_dump()) for movement in content.movements),
        **figures,
    )


def _to_port(content: _FlatPortModel | _DomePortModel | None) -> Port | None:
    if content is None:
        return None
    if isinstance(content, _DomePortModel):
        return DomePort()
    if (content.water is None) == (content.water_index is None):
        raise CalibrationError(
            "port: give either water (temperature_c, salinity_psu, depth_m) or water_index"
        )
    water_index = content.water_index or seawater_index(**dict(content.water or ()))
    left, right = (
        FlatWindow(
            window.distance_mm / 1000,
            window.thickness_mm / 1000,
            np.array(window.normal, dtype=np.float64),
        )
        for window in (content.left, content.right)
    )
    return FlatPort(left, right, content.working_range_m, water_index, content.glass_index)


def _port_content(port: Port) -> dict[str, Any]:
    if isinstance(port, DomePort):
        return {"type": "dome"}
    windows = {
        side: {
            "distance_mm": w.distance_m * 1000,
            "thickness_mm": w.thickness_m * 1000,
            "normal": w.normal.tolist(),
        }
        for side, w in (("left", port.left), ("right", port.right))
    }
    indices = {"water_index": port.water_index, "glass_index": port.glass_index}
    return {"type": "flat", "working_range_m": port.working_range_m, **indices, **windows}


def _to_camera(content: _CameraModel, side: str) -> Camera:
    with naming(side):
        return Camera(
            K=np.array(content.K, dtype=np.float64),
            distortion=np.array(content.distortion, dtype=np.float64),
            image_size=content.image_size,
            model=content.model,
        )


def _first_problem(error: ValidationError) -> str:
    problem = error.errors()[0]
    key = ".".join(str(part) for part in problem["loc"]) or "the file"
    got = "" if problem["type"] == "missing" else f" (got {str(problem['input'])[:80]!r})"
    return (
        f"{key}: {problem['msg'][0].lower()}{problem['msg'][1:]}{got}; see docs/calibration.md "
        "for the format"
    )

"""Stereo calibration in clear water: rigs, their file formats, rectification and geometry."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration.errors import CalibrationError
    from calibration.geometry import RectifiedPair
    from calibration.rectification import Rectification
    from calibration.rig import Camera, StereoRig

_PLACES = {
    "CalibrationError": "errors",
    "Camera": "rig",
    "Rectification": "rectification",
    "RectifiedPair": "geometry",
    "StereoRig": "rig",
}
"""Where each public name is defined; OpenCV is loaded when a name that needs it is used."""

__all__ = ["CalibrationError", "Camera", "Rectification", "RectifiedPair", "StereoRig"]


def __getattr__(name: str) -> Any:
    """Load a public name when it is used."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)

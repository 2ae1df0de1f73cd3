"""Stereo calibration in clear water: rigs, their file formats, rectification and geometry."""

from calibration.errors import CalibrationError
from calibration.geometry import RectifiedPair
from calibration.rectification import Rectification
from calibration.rig import Camera, StereoRig

__all__ = ["CalibrationError", "Camera", "Rectification", "RectifiedPair", "StereoRig"]

"""The flat or dome port that cameras look through under water, and its materials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError, length_m

FLAT_PORT = "30mm:10mm"
"""Lens to window, and its thickness, of usual housings: what is proposed where nothing is known.
Ranges at 0.5 to 5 m are then right to about a percent for windows at 0 to 100 mm; without a port
they are a quarter wrong.
"""
# of divers and vehicles over reefs; 0.5 to 5 m leave 0.4 % at most (docs/calibration.md)
WORKING_RANGE = "1.5m"
# sea water of any temperature differs by 0.2 % in its index, fresh water by 0.5 %
WATER_C, WATER_PSU = (15.0, 35.0)
MAX_DISTANCE_M = 0.5  # larger housings are unknown: more is a mistake of unit
MAX_THICKNESS_M = 0.1  # the same
MAX_TILT_DEG = 30.0  # a window seen at more would be seen from the side
BAR_PER_M = 0.1005  # pressure of sea water: 1025 kg/m3 times 9.81 m/s2


@dataclass(frozen=True, eq=False)
class FlatWindow:
    """The flat window before one camera.

    distance_m: from the camera's optical center to the inside of the glass, along the normal.
    thickness_m: of the glass.
    normal: (3,) in the camera's axes, pointing out into the water; made a unit vector here.

    Raises CalibrationError for what no window can be.
    """

    distance_m: float
    thickness_m: float
    normal: NDArray[np.float64]

    def __post_init__(self) -> None:
        if not 0 <= self.distance_m <= MAX_DISTANCE_M:
            raise CalibrationError(
                f"port: distance of {self.distance_m:g} m to the glass is impossible: 0 to "
                f"{MAX_DISTANCE_M} m"
            )
        if not 0 <= self.thickness_m <= MAX_THICKNESS_M:
            raise CalibrationError(
                f"port: glass of {self.thickness_m:g} m is impossible: 0 to {MAX_THICKNESS_M} m"
            )
        length = float(np.linalg.norm(self.normal))
        if (
            self.normal.shape != (3,)
            or not self.normal[2] >= length * np.cos(np.radians(MAX_TILT_DEG)) > 0
        ):
            raise CalibrationError(
                f"port: the normal {self.normal.tolist()} must point out of the camera, within "
                f"{MAX_TILT_DEG:g} degrees of its axis"
            )
        object.__setattr__(self, "normal", self.normal / length)


@dataclass(frozen=True, eq=False)
class FlatPort:
    """Flat windows before cameras that were calibrated in air. working_range_m: the distance for
    which images are made exact. Indices are relative to air, as published for water and glass.
    """

    left: FlatWindow
    right: FlatWindow
    working_range_m: float
    water_index: float
    glass_index: float = 1.49  # acrylic; glass 1.52, sapphire 1.77

    def __post_init__(self) -> None:
        for name in ("water_index", "glass_index"):
            if not 1 <= getattr(self, name) <= 2.5:
                raise CalibrationError(
                    f"port: {name} of {getattr(self, name):g} is impossible: 1 to 2.5"
                )
        if not 0.1 <= self.working_range_m <= 100:
            raise CalibrationError(
                f"port: working_range_m of {self.working_range_m:g} m is impossible: 0.1 to 100 m"
            )


DESCRIBE_PORT = f"--set input.flat_port={FLAT_PORT} (lens to window, and its thickness)"


def flat_port(text: str) -> FlatPort:
    """The port of ``DISTANCE:THICKNESS`` or ``DISTANCE:THICKNESS:WORKING_RANGE``, lengths with
    units: ``30mm:10mm:1.5m``.

    Both windows alike and square to the cameras, acrylic, in sea water. Raises CalibrationError.
    """
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise CalibrationError(
            f"flat port {text!r}: expected the distance from lens to window and the thickness of "
            f"the window, such as {FLAT_PORT}"
        )
    distance_m, thickness_m, range_m = (
        length_m(part, f"flat port {text!r}") for part in (*parts, WORKING_RANGE)[:3]
    )
    window = FlatWindow(distance_m, thickness_m, np.array([0.0, 0.0, 1.0]))
    return FlatPort(window, window, range_m, seawater_index(WATER_C, WATER_PSU))


@dataclass(frozen=True)
class DomePort:
    """Domes whose centers are the cameras' optical centers: rays meet the glass squarely and pass
    unbent, so nothing is changed.

    A dome off center bends light as a lens would; calibrate such a rig in water.
    """


Port = FlatPort | DomePort


def seawater_index(
    temperature_c: float, salinity_psu: float, depth_m: float = 0.0, wavelength_nm: float = 530.0
) -> float:
    """Refractive index of water relative to air, to about 1e-4.

    Quan and Fry 1995, Appl. Opt. 34(18) 3477, eq. 3: 0 to 30 degrees C, 0 to 35 psu, 400 to 700 nm;
    with the pressure term of Schuster 2002 (The optical properties of the deep Mediterranean,
    thesis, Oxford), 1.45e-5 per bar.

    Raises CalibrationError outside of this range (and a little: the Red Sea, the poles).
    """
    for name, value, low, high in (
        ("temperature_c", temperature_c, -2, 40),
        ("salinity_psu", salinity_psu, 0, 45),
        ("depth_m", depth_m, 0, 11000),
        ("wavelength_nm", wavelength_nm, 380, 750),
    ):
        if not low <= value <= high:
            raise CalibrationError(f"water: {name} of {value:g} is outside of {low} to {high}")
    T, S, wave = temperature_c, salinity_psu, wavelength_nm
    surface = (
        1.31405
        + (1.779e-4 - 1.05e-6 * T + 1.6e-8 * T**2) * S
        - 2.02e-6 * T**2
        + (15.868 + 0.01155 * S - 0.00423 * T) / wave
        - 4382 / wave**2
        + 1.1455e6 / wave**3
    )
    return surface + 1.45e-5 * BAR_PER_M * depth_m

"""The water between camera and reef: the parameters of its model, and their JSON file."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.json_values import JsonText, plain
from stereo_seecolor.files.text_documents import read_json
from stereo_seecolor.water import physics
from stereo_seecolor.water.limits import MATRICES, PARAMETERS, problem_of

FORMAT = "stereo-seecolor/water"
VERSION = 1

PerChannel = NDArray[np.float64]
"""(3,) float64 in the order R, G, B."""
Matrix = NDArray[np.float64]
"""(3, 3) float64: row i makes channel i."""


@dataclass(frozen=True, eq=False, repr=False)
class Water:
    """The water between camera and reef, one value a channel (R, G, B): DeepSeeColor's model, with
    a white point.

    I_c = J_c white_c A_c(z) + B_c(z)
    B_c(z) = gamma_inf (1 - exp(-beta z)) + eta exp(-alpha z) (paper eq.
    sea-thru-backscatter-residual)
    A_c(z) = exp(-z (w exp(-v z) + y exp(-x z))) (paper eq. sea-thru-atten-coeff)

    gamma_inf, eta, white: intensities as a fraction of full scale, 0 or above (white: above 0).
    beta, alpha, v, x: 1/m, 0 or above.
    w, y: 1/m; one may be negative as long as light never grows with range.
    standard_errors: name of a parameter -> (3,) standard error, NaN where the data add nothing to
    the prior. They are marginal: each holds what all other parameters leave open. Method robust
    gives those of y, w, beta, gamma_inf, white (of white the color: its level is exposure); the
    paper's method none.
    input_encoding: encoding of the images that it was fitted to. warnings: of the fit.
    exposure: gain at which its frames are shown, None where each frame has its own. highlights:
    light of so many times the brightest light shown is rolled off to it at that exposure, 1 = no
    roll-off.
    fall_off: power of the range by which the light of lamps on the rig falls off, beside A: 0 for
    daylight, 2 for lamps at the camera. matrix: (3, 3) from the camera's colors to those of sRGB,
    applied to J in linear light; rows sum to 1, so that gray stays gray. matrix_errors: (3, 3) its
    standard errors; None where it was not measured.
    final_sigmoid: above 0, the backscatter is this times the sigmoid of B above, as the paper
    prints it, and gamma_inf and eta have any sign.
    typical_range_m: median range of the pixels that it was fitted to, at which frames without any
    known range are corrected; None where it is not known.

    Raises ColorError for values that no water has.
    """

    gamma_inf: PerChannel
    beta: PerChannel
    eta: PerChannel
    alpha: PerChannel
    w: PerChannel
    v: PerChannel
    y: PerChannel
    x: PerChannel
    white: PerChannel = field(default_factory=lambda: np.ones(3))
    standard_errors: dict[str, PerChannel] = field(default_factory=dict)
    input_encoding: Literal["srgb", "linear", "as-is"] = "srgb"
    warnings: tuple[str, ...] = ()
    exposure: float | None = None
    highlights: float = 1.0
    fall_off: float = 0.0
    matrix: Matrix = field(default_factory=lambda: np.eye(3))
    matrix_errors: Matrix | None = None
    final_sigmoid: float = 0.0
    typical_range_m: float | None = None

    def __post_init__(self) -> None:
        if problem := problem_of(vars(self)):
            raise ColorError(f"water: {problem}")

    def __repr__(self) -> str:
        """Attenuation and backscatter at 1 m, and the white point."""
        near = np.array(1.0)
        shown = {
            "transmission_1m": self.attenuation(near),
            "backscatter_1m": self.backscatter(near),
            "white": self.white,
        }
        numbers = ", ".join(
            f"{name}=[{', '.join(f'{v:.3g}' for v in value)}]" for name, value in shown.items()
        )
        return (
            f"Water({numbers}, {self.input_encoding}{', with warnings' if self.warnings else ''})"
        )

    def backscatter(self, range_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """B_c(z), shape (..., 3), as a fraction of full scale."""
        z, gamma_inf, beta, eta, alpha = _by_channel(
            range_m, self.gamma_inf, self.beta, self.eta, self.alpha
        )
        light = physics.backscatter(z, gamma_inf, beta, eta, alpha)
        return np.moveaxis(
            self.final_sigmoid * physics.sigmoid(light) if self.final_sigmoid else light, 0, -1
        )

    def attenuation(self, range_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """A_c(z) in (0, 1], shape (..., 3); the white point is not in it."""
        z, w, v, y, x = _by_channel(range_m, self.w, self.v, self.y, self.x)
        return np.moveaxis(physics.attenuation(z, w, v, y, x), 0, -1)

    def content(self) -> dict[str, Any]:
        """The water as JSON: lists in the order R, G, B, null for unknown values. What changes
        nothing is left out.
        """
        left_out = (
            *(MATRICES if (self.matrix == np.eye(3)).all() else ()),
            *(() if self.final_sigmoid else ("final_sigmoid",)),
        )
        return {
            part.name: plain(getattr(self, part.name))
            for part in fields(self)
            if part.name not in left_out
        }

    @classmethod
    def from_content(cls, content: Any) -> Self:
        """The water from JSON. Raises ColorError where ``content`` is something else."""
        try:
            values = dict(content)
            errors = {
                str(key): _channels(value)
                for key, value in values.pop("standard_errors", {}).items()
            }
            warnings = tuple(str(warning) for warning in values.pop("warnings", ()))
            parameters: dict[str, Any] = {
                name: _channels(values.pop(name)) for name in PARAMETERS if name in values
            }
            matrices = {name: values.pop(name) for name in MATRICES if values.get(name) is not None}
            parameters |= {name: np.array(matrix, np.float64) for name, matrix in matrices.items()}
            return cls(**parameters, **values, standard_errors=errors, warnings=warnings)
        except (TypeError, ValueError, AttributeError, OverflowError) as error:
            raise ColorError(f"water: is damaged: {error}") from error

    def save(self, path: Path | str) -> None:
        """Write a water.json with this water, as ``--water`` reads it. Raises OutputError."""
        write_atomic(Path(path), water_document({"water": self.content()}))

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a water.json that holds one water. Raises InputError where it cannot be read or
        holds each frame's own.
        """
        path = Path(path)
        body = read_water_document(path)
        if "water" not in body:
            raise InputError(
                f"{path}: holds each frame's own water: run with color.lock=survey for one water "
                "of all frames"
            )
        try:
            return cls.from_content(body["water"])
        except ColorError as error:
            raise InputError(f"{path}: {error}") from error


def water_document(body: dict[str, Any]) -> JsonText:
    """The text of a water.json. body: {"water": content}, or {"frames": {name: content}}."""
    return JsonText({"format": FORMAT, "version": VERSION, **body}, indent=1)


def read_water_document(path: Path) -> dict[str, Any]:
    """Read the body of a water.json. Raises InputError where the file is something else."""
    content = read_json(path)
    if (
        not isinstance(content, dict)
        or content.get("format") != FORMAT
        or content.get("version") != VERSION
    ):
        raise InputError(
            f"{path}: is no {FORMAT} version {VERSION} file: give the water.json of an earlier run"
        )
    return content


def _by_channel(range_m: NDArray[np.floating], *numbers: PerChannel) -> list[NDArray[np.float64]]:
    """Ranges as float64, and (3,) numbers shaped so that products with them are (3, ...): numpy is
    slow at rows of 3.
    """
    z = np.asarray(range_m, dtype=np.float64)
    return [z, *(number.reshape(3, *(1,) * z.ndim) for number in numbers)]


def _channels(values: Any) -> PerChannel:
    return np.array(
        [np.nan if value is None else float(value) for value in values], dtype=np.float64
    )

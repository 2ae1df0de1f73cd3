"""The water between camera and reef: the parameters of its model, and their JSON file."""

from dataclasses import dataclass, field, fields
from numbers import Real
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
    """The water between camera and reef: DeepSeeColor's model with a white point.

    Each parameter is a (3,) float64 array, R, G, B::

        I_c = J_c white_c A_c(z) + B_c(z)
        B_c(z) = gamma_inf (1 - exp(-beta z)) + eta exp(-alpha z)
        A_c(z) = exp(-z (w exp(-v z) + y exp(-x z)))

    B is the paper's eq. sea-thru-backscatter-residual, A its eq. sea-thru-atten-coeff.

    Attributes:
        gamma_inf: Backscatter of infinite water, fraction of full scale, 0 or above.
        beta: Growth of backscatter, 1/m, 0 or above.
        eta: Residual light, fraction of full scale, 0 or above.
        alpha: Attenuation of the residual light, 1/m, 0 or above.
        w: Attenuation that fades with range, 1/m; w or y may be negative as long as light never
            grows with range.
        v: Rate at which w fades, 1/m, 0 or above.
        y: As w.
        x: Rate at which y fades, 1/m, 0 or above.
        white: Color of a white surface without water, fraction of full scale, above 0.
        standard_errors: Parameter -> (3,) standard error, NaN where the data add nothing to the
            prior. They are marginal: each includes the uncertainty of all other parameters. The
            method ``robust`` gives those of y, w, beta, gamma_inf, and of white (of its color: its
            level is exposure); the method ``paper`` none.
        input_encoding: as-is for one that was fitted to values as they are; else it is of linear
            light, however the images encode that.
        warnings: Of the fit, one line each.
        exposure: Gain at which its frames are shown; None where each frame has its own.
        highlights: At that exposure, light of up to this multiple of full scale is compressed to
            full scale; 1 = no roll-off.
        fall_off: Power of the range by which the light of lamps on the rig falls off, besides A: 0
            for daylight, 2 for lamps at the camera.
        matrix: (3, 3) from the camera's colors to those of sRGB, applied to J in linear light; rows
            sum to 1, so that gray stays gray.
        matrix_errors: (3, 3) standard errors of ``matrix``; None where it was not measured.
        final_sigmoid: Above 0, the backscatter is this times the sigmoid of B above, as the paper
            prints it, and gamma_inf and eta have any sign.
        typical_range_m: Median range of the pixels to which it was fitted; frames without any known
            range are corrected for it; None if unknown.

    Raises:
        ColorError: For impossible values.
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
        for name in (*PARAMETERS, "white", "matrix"):
            value = getattr(self, name)
            if isinstance(value, list | tuple):
                object.__setattr__(self, name, np.array(value, np.float64))
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
        as_is = ", as-is" if self.input_encoding == "as-is" else ""
        return f"Water({numbers}{as_is}{', with warnings' if self.warnings else ''})"

    def backscatter(self, range_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """The backscatter B_c(z).

        Args:
            range_m: (...) meters along the ray.

        Returns:
            (..., 3) float64, fraction of full scale.
        """
        z, gamma_inf, beta, eta, alpha = _by_channel(
            range_m, self.gamma_inf, self.beta, self.eta, self.alpha
        )
        light = physics.backscatter(z, gamma_inf, beta, eta, alpha)
        return np.moveaxis(
            self.final_sigmoid * physics.sigmoid(light) if self.final_sigmoid else light, 0, -1
        )

    def attenuation(self, range_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """The attenuation A_c(z), without the white point.

        Args:
            range_m: (...) meters along the ray.

        Returns:
            (..., 3) float64 in (0, 1].
        """
        z, w, v, y, x = _by_channel(range_m, self.w, self.v, self.y, self.x)
        return np.moveaxis(physics.attenuation(z, w, v, y, x), 0, -1)

    def content(self) -> dict[str, Any]:
        """The water for JSON.

        Returns:
            Lists in the order R, G, B, null for unknown values; neutral values are omitted.
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
        """The water from JSON.

        Args:
            content: The result of ``content``, read back.

        Returns:
            The water.

        Raises:
            ColorError: If ``content`` is something else.
        """
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
        """Write the water as a water.json, as ``--water`` reads it.

        Args:
            path: The file.

        Raises:
            OutputError: If it cannot be written.
        """
        write_atomic(Path(path), water_document({"water": self.content()}))

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a water.json with one set of water parameters.

        Args:
            path: The file.

        Returns:
            The water.

        Raises:
            InputError: If it cannot be read, or contains water parameters for each frame.
        """
        path = Path(path)
        body = read_water_document(path)
        if "water" not in body:
            raise InputError(
                f"{path}: contains separate water parameters for each frame: run with "
                "color.lock=survey to get common ones"
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
            f"{path}: is not a {FORMAT} version {VERSION} file: give the water.json of a run"
        )
    return content


def _by_channel(range_m: NDArray[np.floating], *numbers: PerChannel) -> list[NDArray[np.float64]]:
    """Ranges as float64, and (3,) numbers shaped for (3, ...) products: rows of 3 are slow."""
    z = np.asarray(range_m, dtype=np.float64)
    return [z, *(number.reshape(3, *(1,) * z.ndim) for number in numbers)]


def _channels(values: Any) -> Any:
    """(3,) float64, NaN for null; what is not numbers stays, to be named by the limits."""
    is_list = isinstance(values, list) and all(isinstance(v, Real | None) for v in values)
    return np.array([np.nan if v is None else v for v in values], np.float64) if is_list else values

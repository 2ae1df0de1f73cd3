"""Standard errors of a water whose images were read as sRGB without a measured response."""

from dataclasses import replace

import numpy as np

from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import PerChannel, Water


def with_doubt_of_response(water: Water, table: MomentTable, config: ColorConfig) -> Water:
    """Add the doubt of an unmeasured response to the standard errors of a water.

    The other reading is that values are linear light; those of a flatter curve lie between the two.
    Half the difference is added in quadrature, so that two standard errors cover both readings.

    Args:
        water: The fit to ``table``, with standard errors.
        table: The moment table.
        config: Settings of the color stage.

    Returns:
        The water; unchanged unless ``input_encoding`` is unknown. Errors that are NaN stay NaN.
    """
    if config.input_encoding != "unknown" or config.method != "robust" or not table.pixels.any():
        return water
    from stereo_seecolor.color.fitting import robust  # loads torch

    other = robust.fit(table, config.model_copy(update={"input_encoding": "linear"}), water)
    differences = {name: getattr(other, name) - getattr(water, name) for name in ("y", "w", "beta")}
    differences["white"] = water.white * (_color(other.white) - _color(water.white))
    # as a fraction of the light that arrives, because readings differ in brightness
    differences["gamma_inf"] = water.white * (
        other.gamma_inf / other.white - water.gamma_inf / water.white
    )
    return replace(
        water,
        standard_errors={
            name: np.hypot(error, differences[name] / 2)
            for name, error in water.standard_errors.items()
        },
    )


def _color(light: PerChannel) -> PerChannel:
    """(3,) logarithms less their mean."""
    logarithms = np.log(light)
    return np.asarray(logarithms - logarithms.mean())

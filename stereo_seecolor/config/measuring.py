"""The settings of lengths measured in a frame."""

from pydantic import Field

from stereo_seecolor.config.stage import StageConfig


class MeasuringConfig(StageConfig):
    """What is known of the rig when lengths are measured."""

    length_error: float | None = Field(
        default=None,
        ge=0,
        lt=1,
        description="Standard error of a length that comes from the calibration, as a fraction; a bar of known length shows it. "
        "Not set: what the calibration itself states, or else 0.005.",
    )

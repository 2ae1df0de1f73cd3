"""The settings of color: the method, what frames share, and how corrected images are shown."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, Strict, ValidationError, ValidatorFunctionWrapHandler, field_validator

from stereo_seecolor.config.stage import StageConfig

Light = Annotated[float, Field(ge=1e-4, le=1e4)]
Fraction = Annotated[float, Field(ge=0, le=0.5)]
STREAM_FRAMES = 20
"""Number of frames that share water parameters in live, unless another number is set."""
Rgb = Annotated[tuple[Light, Light, Light], Strict(False)]
"""Three positive numbers, also given as a list."""


class RobustConfig(StageConfig):
    """The default method: physics with a white point, fitted to quantiles of color over range."""

    white_point: Literal["scene", "gray", "none"] | Rgb = Field(
        default="scene",
        description="The color of the light that arrives at the reef. scene: fitted with the "
        "water, for a reef with warm colors on average, like sand and rock. gray: the same, "
        "for colors that are gray on average. none: white, as in the paper's model. Or the "
        "known R, G, B in linear light, for example from a white card; only their ratios count.",
    )

    brightest: Literal["auto", "white", "mixed", "sand"] = Field(
        default="auto",
        description="The color of the brightest things. white: nearly white (a card, a wall, "
        "reflections). sand: as warm as the sea floor. mixed: halfway. auto: mixed for frames that "
        "share water parameters (color.lock), because few of them show a card; white for single "
        "images.",
    )

    daylight_depth_m: ClassVar[float | None] = None
    """Length of the light's path from the water surface down to the reef, meters; None: unknown."""

    @property
    def fits_white(self) -> bool:
        """Whether the white point is fitted with the water."""
        return self.white_point in ("scene", "gray")

    @field_validator("white_point", mode="wrap")
    @classmethod
    def _one_line(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError as error:
            raise ValueError(
                "must be scene, gray, none, or [R, G, B], each from 0.0001 to 10000"
            ) from error


class LampsConfig(RobustConfig):
    """The same for a dive lit mainly by lamps on the rig: no light comes down from the surface."""

    daylight_depth_m: ClassVar[float | None] = 0.0


class PaperConfig(StageConfig):
    """The paper's method (DeepSeeColor): two networks over range, trained by Adam."""

    iterations: int = Field(
        default=500,
        ge=1,
        description=(
            "Training steps of both networks on a frame, or on frames that share water parameters."
        ),
    )
    iterations_per_frame: int = Field(
        default=20,
        ge=1,
        description="Training steps on a frame of a stream, starting from the water of the "
        "previous frame: in live, with a number as lock, and with lock frame if both frames show "
        "the same spots. live takes fewer steps if --budget-ms leaves no time.",
    )
    final_sigmoid: bool = Field(
        default=False,
        description="true: the backscatter network ends in a sigmoid, as printed. false: "
        "each of its two intensities passes through a sigmoid.",
    )


class ColorConfig(StageConfig):
    """How the water is fitted and images are corrected."""

    method: str = Field(
        default="robust",
        description="robust: physics with a white point, from quantiles of color over range. "
        "paper: DeepSeeColor as published, its two networks trained by Adam. Or one that another "
        "package adds ([extending](extending.md)).",
    )

    @field_validator("method", mode="before")
    @classmethod
    def _renamed(cls, value: Any) -> Any:
        if value == "paper-adam":
            raise ValueError("it is now paper, which trains by Adam")
        return value

    robust: RobustConfig = RobustConfig()
    paper: PaperConfig = PaperConfig()
    lock: Literal["auto", "frame", "survey"] | Annotated[int, Field(ge=1)] = Field(
        default="auto",
        description="Which frames share water parameters. auto: all frames, or each segment of the "
        "dive if the water changes (several sites, a change of depth); for correct the same as "
        "frame. frame: each frame has its own. survey: all frames. A number, for example 20: the "
        "last 20 frames; live uses 20 unless a number is set.",
    )

    def of_dive(self) -> "ColorConfig":
        """Return the settings for frames of a dive: with a prior for frames that share a water."""
        if self.lock == "frame" or self.robust.brightest != "auto":
            return self
        robust = self.robust.model_copy(update={"brightest": "mixed"})
        return self.model_copy(update={"robust": robust})

    @property
    def sliding_frames(self) -> int:
        """Number of frames that share the water parameters of a stream."""
        return self.lock if isinstance(self.lock, int) else STREAM_FRAMES

    @field_validator("lock", mode="wrap")
    @classmethod
    def _lock_in_one_line(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        if value == "sliding":
            raise ValueError("it is now the number of frames that share one water, such as 20")
        try:
            return handler(value)
        except ValidationError as error:
            raise ValueError("must be auto, frame, survey, or a number of frames from 1") from error

    camera_exposure: Literal["auto", "fixed", "brightness"] = Field(
        default="auto",
        description="Differences of exposure between frames. auto: a gain for each frame, from "
        "spots that several frames show, if frames then agree better. fixed: constant exposure. "
        "brightness: a gain for each frame, from its brightness at equal ranges.",
    )
    input_encoding: Literal["auto", "srgb", "linear", "as-is", "unknown"] = Field(
        default="auto",
        description="How images encode light. auto: measured from the noise of the images, "
        "with the pedestal; unknown if that is not possible. srgb: encoded for a screen. "
        "linear: linear light. as-is: corrected without decoding. unknown: read as srgb; standard "
        "errors of the water cover linear light, too. The output is sRGB, except with as-is.",
    )

    @property
    def encoding(self) -> Literal["srgb", "linear", "as-is"]:
        """``input_encoding``; sRGB if it is unknown, or auto and not measured."""
        if self.input_encoding == "auto" or self.input_encoding == "unknown":
            return "srgb"
        return self.input_encoding

    input_space: Literal["auto", "srgb", "adobe-rgb", "display-p3", "prophoto"] = Field(
        default="auto",
        description="Color space of the images: their primaries, and the curve of encoded values. "
        "auto: the one that the first file states (profile, EXIF); srgb if it states none. Colors "
        "are converted to sRGB first, except with input_encoding=as-is.",
    )

    @property
    def space(self) -> Literal["srgb", "adobe-rgb", "display-p3", "prophoto"]:
        """``input_space``; sRGB if it is auto and no file states another."""
        return "srgb" if self.input_space == "auto" else self.input_space

    pedestal: Annotated[tuple[Fraction, Fraction, Fraction], Strict(False)] = Field(
        default=(0.0, 0.0, 0.0),
        description="Values of R, G, B without light, in linear light as a fraction of full scale. "
        "They are subtracted first. color.input_encoding=auto measures them, too.",
    )
    lights: Literal["auto", "none"] = Field(
        default="auto",
        description="Uneven light. auto: the pattern of lamps and lens, and moving sunlight and "
        "shadows, are estimated from spots that several frames show, and divided out if frames "
        "then agree better. none: no correction.",
    )
    median_luminance: float = Field(
        default=0.18,
        gt=0,
        le=0.5,
        description="Brightness of the output: the median luminance of all frames that share water "
        "parameters, in linear light, as a fraction of full scale. 0.18 is mid-gray. Not for "
        "input_encoding=as-is.",
    )
    unknown_pixels: Literal["interpolate", "black", "raw"] = Field(
        default="interpolate",
        description="Output of pixels without a measured range. interpolate: corrected with the "
        "range of measured neighbors of the same color (mask 2). black: black. raw: the "
        "uncorrected pixel.",
    )

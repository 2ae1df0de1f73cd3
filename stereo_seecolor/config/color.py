"""The settings of color: the method, what frames share, and how corrected images are shown."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, Strict, ValidationError, ValidatorFunctionWrapHandler, field_validator

from stereo_seecolor.config.stage import StageConfig

Light = Annotated[float, Field(ge=1e-4, le=1e4)]
Fraction = Annotated[float, Field(ge=0, le=0.5)]
STREAM_FRAMES = 20
"""Frames that share one water in live, where no other number is set."""
Rgb = Annotated[tuple[Light, Light, Light], Strict(False)]
"""Three positive numbers, also given as a list."""


class RobustConfig(StageConfig):
    """The default method: physics with a white point, fitted to quantiles of color over range."""

    white_point: Literal["scene", "gray", "none"] | Rgb = Field(
        default="scene",
        description="The color of the light that arrives at the reef. scene: fitted with the "
        "water, for a reef whose colors are warm on average, as sand and rock are. gray: the "
        "same, for colors that are gray on average. none: white, as in the paper's model. Or the "
        "known R, G, B, from a white card for example, in linear light, each from 0.0001 to 10000; "
        "only their ratios count.",
    )

    daylight_depth_m: ClassVar[float | None] = None
    """Depth of water that light came down through, meters; None: unknown."""

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
    """The same where lamps on the rig give most of the light: it came down through no water."""

    daylight_depth_m: ClassVar[float | None] = 0.0


class PaperConfig(StageConfig):
    """The paper's method (DeepSeeColor): two networks over range, trained by Adam on a moment
    table.
    """

    iterations: int = Field(
        default=500,
        ge=1,
        description="Steps of both networks on a frame, or on frames that share one water.",
    )
    iterations_per_frame: int = Field(
        default=20,
        ge=1,
        description="Steps on a frame of a stream, from the water of the frame before: in live, "
        "with a number as lock, and with lock frame where run finds that it shows the same spots. "
        "live takes fewer where --budget-ms leaves no time for them.",
    )
    final_sigmoid: bool = Field(
        default=False,
        description="true: the backscatter network ends in a sigmoid, as printed. false: its two "
        "intensities pass through one each.",
    )


class ColorConfig(StageConfig):
    """The water and how it is fitted: images and range maps -> corrected images."""

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
        description="auto: one water for all frames that share it; where they do not (several "
        "sites, a change of depth), one for each segment of the dive. correct, whose pictures may "
        "be unrelated, takes auto as frame. frame: each frame its own water. survey: one water for "
        "all frames. A number, such as 20: the water of so many last frames together; live takes "
        "20 where no number is set.",
    )

    @property
    def sliding_frames(self) -> int:
        """Frames that share the water of a stream."""
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
        description="auto: a gain for each frame, from spots that several frames of run show, "
        "where that makes them agree better. fixed: the camera held its exposure through the "
        "survey. brightness: each frame is brought to one exposure by its brightness at equal "
        "ranges.",
    )
    input_encoding: Literal["auto", "srgb", "linear", "as-is"] = Field(
        default="auto",
        description="How images hold light. auto: measured from the noise of the images, with the "
        "pedestal; srgb where that is not possible. srgb: encoded for a screen. linear: the values "
        "are linear light. as-is: the values are corrected without decoding. The output of all but "
        "as-is is encoded by sRGB.",
    )

    @property
    def encoding(self) -> Literal["srgb", "linear", "as-is"]:
        """``input_encoding``; sRGB where it was not measured."""
        return "srgb" if self.input_encoding == "auto" else self.input_encoding

    pedestal: Annotated[tuple[Fraction, Fraction, Fraction], Strict(False)] = Field(
        default=(0.0, 0.0, 0.0),
        description="Values of R, G, B that the camera gives without light, in linear light as a "
        "fraction of full scale. They are taken off first. With color.input_encoding=auto they are "
        "measured, too.",
    )
    lights: Literal["auto", "none"] = Field(
        default="auto",
        description="auto: the pattern of lamps and lens over picture and range, and sunlight and "
        "shadows that move, are solved from spots that several frames of run show, and divided out "
        "where that makes them agree better. none: nothing is divided out.",
    )
    median_luminance: float = Field(
        default=0.18,
        gt=0,
        le=0.5,
        description="How bright frames are shown: the median luminance of all frames that share a "
        "water, in linear light, as a fraction of full scale. 0.18 is mid-gray. Light above it is "
        "compressed where the brightest would clip. Not for images read as as-is.",
    )
    unknown_pixels: Literal["interpolate", "black", "raw"] = Field(
        default="interpolate",
        description="What is painted where no range was measured. interpolate: corrected with a "
        "range carried over from measured neighbors of the same color (mask 2; range/ stays as "
        "measured). black: black. raw: the pixel as the camera saw it.",
    )

"""The settings of stereo matching."""

from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from stereo_seecolor.config.stage import FilePath, StageConfig


class MatchingConfig(StageConfig):
    """Stereo matching: StereoFrame -> RangeMap."""

    min_range_m: float = Field(
        0.3,
        gt=0,
        description="Nearest range looked for, meters; sets the largest disparity searched.",
    )
    max_range_m: float = Field(
        default=20.0, gt=0, description="Farthest range kept, meters; more than the nearest."
    )
    min_confidence: float = Field(
        default=0.8,
        ge=0,
        le=1,
        description="Pixels whose disparity is right to within one pixel with a lower "
        "probability than this are left unknown.",
    )
    fill: bool = Field(
        default=False,
        description="Close the holes with what their neighbors suggest; such pixels are marked.",
    )
    engine: str = Field(
        default="sgm",
        description="sgm: semi-global matching of the census. opencv: OpenCV's StereoSGBM, for "
        "comparison. onnx: your own stereo "
        "network, run by onnxruntime. Or one that another package adds (docs/extending.md).",
    )
    model: FilePath | None = Field(
        default=None,
        description="The network of engine onnx: an .onnx file (contract in docs/matching.md).",
    )

    @field_validator("engine", mode="before")
    @classmethod
    def _known_engine(cls, engine: Any) -> Any:
        if engine == "sgbm":
            raise ValueError("is now called 'sgm'; 'opencv' is OpenCV's StereoSGBM")
        return engine

    @model_validator(mode="after")
    def _near_before_far(self) -> Self:
        if self.max_range_m <= self.min_range_m:
            raise ValueError(
                f"max_range_m ({self.max_range_m:g}) must be more than min_range_m "
                f"({self.min_range_m:g})"
            )
        return self

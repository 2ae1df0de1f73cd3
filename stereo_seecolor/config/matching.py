"""The settings of stereo matching."""

from pathlib import Path
from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from stereo_seecolor.config.stage import StageConfig


class MatchingConfig(StageConfig):
    """How the ranges of a pair are computed."""

    min_range_m: float = Field(
        0.3, gt=0, description="Nearest range of the search, meters; sets the largest disparity."
    )
    max_range_m: float = Field(
        default=20.0,
        gt=0,
        description="Farthest range kept, meters; must be more than the nearest.",
    )
    min_confidence: float = Field(
        default=0.8,
        ge=0,
        le=1,
        description="Pixels are unknown if the probability that their disparity is correct within "
        "one pixel is lower than this.",
    )
    fill: bool = Field(
        default=False,
        description="Fill holes with the ranges of neighbors; filled pixels are marked.",
    )
    engine: str | Path = Field(
        default="sgm",
        description="sgm: semi-global matching of the census. opencv: OpenCV's StereoSGBM, for "
        "comparison. An .onnx file: your own stereo network, run by onnxruntime (contract in "
        "docs/matching.md). Or one that another package adds (docs/extending.md).",
    )

    @field_validator("engine", mode="before")
    @classmethod
    def _known_engine(cls, engine: Any) -> Any:
        if engine == "sgbm":
            raise ValueError("is now called 'sgm'; 'opencv' is OpenCV's StereoSGBM")
        if engine == "onnx":
            raise ValueError("name the network's file itself: matching.engine=NET.onnx")
        return Path(engine) if str(engine).endswith(".onnx") else engine

    @model_validator(mode="after")
    def _near_before_far(self) -> Self:
        if self.max_range_m <= self.min_range_m:
            raise ValueError(
                f"max_range_m ({self.max_range_m:g}) must be more than min_range_m "
                f"({self.min_range_m:g})"
            )
        return self

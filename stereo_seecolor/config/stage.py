"""The base of the settings of every stage; and those of inputs, matching and output."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Strict

FilePath = Annotated[Path, Strict(False)]
"""A path, also given as text."""


class StageConfig(BaseModel):
    """Frozen settings, strictly checked: true, "1", infinity and NaN are not numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

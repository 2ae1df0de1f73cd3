"""What the settings of every stage have in common."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Strict

FilePath = Annotated[Path, Strict(False)]
"""A path, also given as text."""


class StageConfig(BaseModel):
    """Strict: true is no number, "1" is none, and neither are infinity and NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

"""What the settings of every stage have in common."""

from pydantic import BaseModel, ConfigDict


class StageConfig(BaseModel):
    """Strict: true is no number, "1" is none, and neither are infinity and NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

"""Fixtures that many tests share."""

from pathlib import Path

import pytest

REAL_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture
def real_data() -> Path:
    """The folder of real frames, stereo pairs and chessboards; skips where it is absent."""
    if not REAL_DATA.is_dir():
        pytest.skip(f"real frames are not in the repository, and {REAL_DATA} does not exist here")
    return REAL_DATA

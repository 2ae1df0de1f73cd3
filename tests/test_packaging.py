"""What is installed is these two packages and nothing more, and the documentation builds without a warning."""

import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def test_two_packages_are_installed() -> None:
    assert set((distribution("stereo-seecolor").read_text("top_level.txt") or "").split()) == {"calibration", "stereo_seecolor"}


def test_every_folder_of_code_is_a_package() -> None:
    for package in ("calibration", "stereo_seecolor"):
        folders = {path.parent for path in (ROOT / package).rglob("*.py")}
        assert all((folder / "__init__.py").exists() for folder in folders)


def test_calibration_needs_nothing_of_the_program() -> None:
    code = "import sys, calibration, calibration.calibrate, calibration.formats; print(sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not [name for name in ("'stereo_seecolor'", "'torch'", "'open3d'") if name in loaded]


def test_documentation_builds(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="the docs extra is not installed")
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(ROOT / "docs"), str(tmp_path)],
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    settings = (tmp_path / "configuration.html").read_text()
    assert "color.lock" in settings
    assert "stereo-seecolor run" in (tmp_path / "commands.html").read_text()

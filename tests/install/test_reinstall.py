"""The package installed, used, installed again from its folder and removed, in an environment of
its own.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
USE = (
    "from stereo_seecolor.mapping.surface.color_weight import color_weight as weight; "
    "print(weight(1.0, False), weight.missing)"
)
PLACE = "import stereo_seecolor as it; from stereo_seecolor import run; print(it.__file__)"
INSTALL = ("-m", "pip", "install", "--no-deps", "--no-build-isolation", "--no-index")


@pytest.fixture
def call(tmp_path: Path) -> Callable[..., str]:
    """Run the Python of a new environment, which finds the libraries of this one; gives its
    output.
    """
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    python = venv / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    usual = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    usual |= {"HOME": str(tmp_path), "LOCALAPPDATA": str(tmp_path)}

    def run(*words: str) -> str:
        done = subprocess.run(
            [python, *words],
            cwd=tmp_path,
            env=usual,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        return done.stdout.strip()

    own = run("-c", "import sysconfig; print(sysconfig.get_path('purelib'))")
    Path(own, "libraries.pth").write_text(
        "".join(f"{place}\n" for place in sys.path if place.endswith("site-packages"))
    )
    return run


@pytest.mark.slow
def test_a_package_that_was_installed_again_is_found_and_one_that_was_removed_is_not(
    call: Callable[..., str], tmp_path: Path
) -> None:
    """Compiled kernels must leave no folder of the package's name behind: Python would take it for
    the package.
    """
    source = tmp_path / "source"
    for name in ("stereo_seecolor", "calibration"):
        shutil.copytree(
            REPOSITORY / name, source / name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(REPOSITORY / name, source)

    call(*INSTALL, "./source")
    assert str(tmp_path / "venv") in call("-c", PLACE)
    assert call("-c", USE) == "0.5 False", "the kernel is compiled and kept"

    call(*INSTALL, "-e", "./source")
    assert call("-c", PLACE) == str(source / "stereo_seecolor" / "__init__.py")
    assert call("-m", "stereo_seecolor", "inspect", "nothing").count("does not exist") == 1

    call("-m", "pip", "uninstall", "-y", "stereo-seecolor")
    left = call(
        "-c",
        "from importlib.util import find_spec; it = find_spec('stereo_seecolor'); print(it and "
        "it.origin or it)",
    )
    assert left == "None" or (str(tmp_path) not in left and "NamespaceLoader" not in left)

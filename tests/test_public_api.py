"""What the top of the package exports can be imported, and importing the package alone loads nothing heavy."""

import subprocess
import sys

import pytest

import stereo_seecolor


@pytest.mark.parametrize("name", stereo_seecolor.__all__)
def test_every_public_name_can_be_imported_and_says_what_it_is(name: str) -> None:
    public = getattr(stereo_seecolor, name)
    assert name == "__version__" or public.__doc__


def test_a_name_that_does_not_exist_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Pipelin'"):
        stereo_seecolor.Pipelin  # noqa: B018


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import sys, stereo_seecolor; print([m for m in ('cv2', 'torch', 'numba', 'scipy', 'open3d') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"

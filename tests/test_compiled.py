import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import stereo_seecolor

KERNEL = """
from numpy.typing import NDArray
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.numbers import FACTOR, twice

@compiled
def scaled(value: int) -> int:
    return FACTOR * twice(value)
"""
NUMBERS = """
from stereo_seecolor.compute.compiled import compiled

FACTOR = 10

@compiled
def twice(value):
    return 2 * value
"""
CALL = """
import sys
from stereo_seecolor.kernel import scaled
missing = scaled.missing
print(scaled(3), sum(scaled.dispatcher.stats.cache_hits.values()))
assert not (missing and scaled.dispatcher.stats.cache_hits.total())
compiled_now = not scaled.dispatcher.stats.cache_hits.total()
assert ("numba.cpython.printimpl" in sys.modules) == compiled_now, "what only the compiler needs takes long to import"
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The folder of a copy of the package that has two modules more, with a compiled function each."""
    copy = tmp_path / "site" / "stereo_seecolor"
    shutil.copytree(Path(stereo_seecolor.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "kernel.py").write_text(KERNEL)
    (copy / "numbers.py").write_text(NUMBERS)
    return copy


@pytest.fixture
def call(package: Path, tmp_path: Path) -> Callable[..., tuple[int, int]]:
    """Run the compiled function in a new process; gives its result and how often machine code was found on disk."""

    def run(**environment: str) -> tuple[int, int]:
        usual = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")}
        usual |= {"PYTHONPATH": str(package.parent), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-c", CALL], cwd=package.parent, env=usual | environment, capture_output=True, text=True, check=True
        )
        assert done.stderr == ""
        result, hits = done.stdout.split()
        return int(result), int(hits)

    return run


@pytest.mark.slow
def test_machine_code_is_kept_until_a_source_that_it_was_made_of_changes(
    package: Path, call: Callable[..., tuple[int, int]]
) -> None:
    assert call() == (60, 0)
    assert call() == (60, 1)
    files = set((package / "__pycache__" / "compiled").iterdir())

    (package / "errors.py").write_text("# nothing that the compiled function imports\n")
    assert call() == (60, 1)

    (package / "numbers.py").write_text(NUMBERS.replace("10", "100"))
    assert call() == (600, 0)

    (package / "numbers.py").write_text(NUMBERS.replace("2 * value", "3 * value"))
    assert call() == (90, 0)
    assert set((package / "__pycache__" / "compiled").iterdir()) == files


@pytest.mark.slow
def test_the_users_cache_folder_serves_where_the_package_cannot_be_written(
    package: Path, call: Callable[..., tuple[int, int]], tmp_path: Path
) -> None:
    (package / "__pycache__").write_text("no folder can be made here")
    assert call(XDG_CACHE_HOME=str(tmp_path / "cache")) == (60, 0)
    assert call(XDG_CACHE_HOME=str(tmp_path / "cache")) == (60, 1)


@pytest.mark.slow
def test_the_users_cache_folder_stays_bounded(package: Path, call: Callable[..., tuple[int, int]], tmp_path: Path) -> None:
    (package / "__pycache__").write_text("no folder can be made here")
    for number in range(20):
        (tmp_path / "cache" / "stereo-seecolor" / str(number)).mkdir(parents=True)
    assert call(XDG_CACHE_HOME=str(tmp_path / "cache")) == (60, 0)
    assert len(list((tmp_path / "cache" / "stereo-seecolor").iterdir())) == 8
    assert call(XDG_CACHE_HOME=str(tmp_path / "cache")) == (60, 1)


@pytest.mark.slow
def test_runs_without_a_place_for_machine_code(package: Path, call: Callable[..., tuple[int, int]], tmp_path: Path) -> None:
    (package / "__pycache__").write_text("no folder can be made here")
    (tmp_path / "file").write_text("")
    nowhere = str(tmp_path / "file" / "cache")
    assert call(HOME=nowhere, XDG_CACHE_HOME=nowhere) == (60, 0)
    assert call(HOME="~", XDG_CACHE_HOME="") == (60, 0)


@pytest.mark.slow
def test_damaged_machine_code_is_compiled_again(package: Path, call: Callable[..., tuple[int, int]]) -> None:
    call()
    for file in (package / "__pycache__" / "compiled").iterdir():
        file.write_bytes(file.read_bytes()[:100])
    assert call() == (60, 0)


def test_importing_a_compiled_function_leaves_numba_alone() -> None:
    code = "import sys; import stereo_seecolor.matching.fill; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"

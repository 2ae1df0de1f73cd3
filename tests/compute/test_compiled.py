import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
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
"""  # noqa: E501


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The folder of a copy of the package that has two modules more, with a compiled function
    each.
    """
    copy = tmp_path / "site" / "stereo_seecolor"
    shutil.copytree(
        Path(stereo_seecolor.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    (copy / "kernel.py").write_text(KERNEL)
    (copy / "numbers.py").write_text(NUMBERS)
    return copy


@pytest.fixture
def call(package: Path, tmp_path: Path) -> Callable[..., tuple[int, ...]]:
    """Run the compiled function in a new process; gives its result and how often machine code was
    found on disk.
    """

    def run(code: str = CALL, **environment: str) -> tuple[int, ...]:
        usual = {
            name: value
            for name, value in os.environ.items()
            if name not in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")
        }
        usual |= {
            "PYTHONPATH": str(package.parent),
            "HOME": str(tmp_path),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path)],
            cwd=package.parent,
            env=usual | environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == ""
        return tuple(map(int, done.stdout.split()))

    return run


def cached(home: Path) -> list[Path]:
    """The files of machine code in a home folder, without the tag."""
    return sorted(path for path in home.rglob("*.nb[ic]"))


@pytest.mark.slow
def test_machine_code_is_kept_until_a_source_that_it_was_made_of_changes(
    package: Path, call: Callable[..., tuple[int, ...]], tmp_path: Path
) -> None:
    call = partial(call, NUMBA_CACHE_DIR=str(tmp_path / "numba"))
    assert call() == (60, 0)
    assert call() == (60, 1)
    files = cached(tmp_path)
    assert len(files) == len(cached(tmp_path / "numba")) == 2
    assert not list(package.rglob("__pycache__")), "the cache lies outside the package"

    (package / "errors.py").write_text("# nothing that the compiled function imports\n")
    assert call() == (60, 1)

    (package / "numbers.py").write_text(NUMBERS.replace("10", "100"))
    assert call() == (600, 0)

    (package / "numbers.py").write_text(NUMBERS.replace("2 * value", "3 * value"))
    assert call() == (90, 0)
    assert cached(tmp_path) == files


@pytest.mark.slow
def test_cleaning_the_cache_deletes_nothing_but_machine_code(
    call: Callable[..., tuple[int, ...]], tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    variable = "XDG_CACHE_HOME" if sys.platform == "linux" else "NUMBA_CACHE_DIR"
    assert call(**{variable: str(cache)}) == (60, 0)
    installation = cached(cache)[0].parent
    assert installation.name != "stereo-seecolor"
    mine = [
        place / f"{number:02}" / "left.png"
        for place in {installation.parent, cache / "stereo-seecolor"}
        for number in range(20)
    ]
    others = [installation.parent / f"other{number:02}" for number in range(20)]
    for file in (*mine, others[0] / "notes.txt"):
        file.parent.mkdir(parents=True)
        file.write_text("of a user")
        os.utime(file.parent, (0, 0))
    for number, other in enumerate(others):
        other.mkdir(exist_ok=True)
        for file in installation.iterdir():
            shutil.copy(file, other)
        for file in other.glob("CACHEDIR.TAG"):
            os.utime(file, (number, number))
    shutil.rmtree(installation)

    assert call(**{variable: str(cache)}) == (60, 0)
    assert all(file.read_text() == "of a user" for file in (*mine, others[0] / "notes.txt"))
    assert [other.name for other in others if list(other.glob("*.nb[ic]"))] == [
        f"other{number:02}" for number in range(5, 20)
    ]
    assert not others[1].exists()
    assert call(**{variable: str(cache)}) == (60, 1)


@pytest.mark.slow
@pytest.mark.posix
def test_machine_code_is_loaded_only_from_a_private_folder(
    call: Callable[..., tuple[int, ...]], tmp_path: Path
) -> None:
    assert call() == (60, 0)
    (place,) = {path.parent.parent for path in cached(tmp_path)}
    assert place.stat().st_mode & 0o777 == 0o700
    place.chmod(0o777)
    assert call() == (60, 0)
    place.chmod(0o700)
    assert call() == (60, 1)
    place.rename(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere")
    assert call() == (60, 0)


NO_HOME = "import sys; sys.modules['pwd'] = None\n"
"""Else a relative HOME means the folder that the system lists for the user: code is found there."""


@pytest.mark.slow
def test_runs_without_a_place_for_machine_code(
    call: Callable[..., tuple[int, ...]], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    nowhere = str(tmp_path / "file" / "cache")
    assert call(HOME=nowhere, XDG_CACHE_HOME=nowhere) == (60, 0)
    assert call(NO_HOME + CALL, HOME="~", XDG_CACHE_HOME="") == (60, 0)


DAMAGE = """
import sys
from pathlib import Path
from stereo_seecolor.compute.kernel_cache import dispatcher
from stereo_seecolor.kernel import scaled

def call():
    found = dispatcher(scaled.py_func, scaled._options)
    return found(3), found.stats.cache_hits.total()

def flipped(content, place):
    changed = bytearray(content)
    changed[place] ^= 1
    return bytes(changed)

files = sorted(Path(sys.argv[1]).rglob("*.nb[ic]"))
assert len(files) == 2 and call() == (60, 1)
for file in files:
    content = file.read_bytes()
    flips = [flipped(content, place) for place in (0, 40, len(content) // 2, -1)]
    for number, damaged in enumerate((content[:100], b"", *flips)):
        file.write_bytes(damaged)
        assert call() == (60, 0), (file, number)
        assert call() == (60, 1), (file, number)
"""
"""In one process, which compiles the function or loads it for each call."""


@pytest.mark.slow
def test_damaged_machine_code_is_compiled_again(
    call: Callable[..., tuple[int, ...]], tmp_path: Path
) -> None:
    call()
    assert call(code=DAMAGE) == ()


@pytest.mark.slow
def test_importing_a_compiled_function_leaves_numba_alone() -> None:
    code = "import sys; import stereo_seecolor.matching.disparity; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"

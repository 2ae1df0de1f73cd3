"""Each command with each kind of place that the system refuses: one line that names it, never a
traceback.
"""

import errno
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import command, write_dive

pytestmark = [pytest.mark.slow, pytest.mark.posix]
X, DIVE = "{X}", "{DIVE}"
SIDES = ["--left", f"{DIVE}/L", "--right", f"{DIVE}/R", "--calib", f"{DIVE}/cam.yaml"]
COMMANDS = (
    ["run", "--left", X, "--right", X, "--calib", f"{DIVE}/cam.yaml", "--out", "o"],
    ["run", *SIDES[:4], "--calib", X, "--out", "o"],
    ["run", *SIDES, "--out", X],
    ["run", *SIDES, "--out", "o", "--config", X],
    ["run", *SIDES, "--out", "o", "--water", X],
    ["run", *SIDES, "--out", "o", "--poses", X, "--fuse"],
    ["run", *SIDES, "--out", "o", "--log-file", X],
    ["correct", "--images", X, "--ranges", X, "--out", "o"],
    ["rectify", *SIDES, "--out", X],
    ["check", *SIDES[:4], "--calib", X],
    ["inspect", X],
    ["convert-calib", X, "o.yaml"],
    ["convert-calib", f"{DIVE}/cam.yaml", X],
    ["calibrate", X, "--target", "chessboard:9x6:30mm", "--out", "c.yaml"],
    ["fuse", X],
    ["report", X],
    ["view", X],
    ["measure", X, "0001"],
    ["metrics", X],
    ["compare", X, X],
    ["markers", X],
    ["merge", X, "--out", "o"],
    ["status", X],
    ["plan", *SIDES, "--out", X],
    ["campaign", X],
    ["evaluate", X],
    ["export", X, "--to", "colmap", "--out", "o"],
    ["bag-info", X],
    ["config", "--config", X],
    ["synthesize", "--out", X, "--pairs", "1"],
)


@pytest.fixture
def locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that may not be searched, for root as well."""
    folder = tmp_path / "locked"
    folder.mkdir()

    def refusing(call: Callable[..., Any]) -> Callable[..., Any]:
        def refuse(path: Any = ".", *rest: Any, **more: Any) -> Any:
            if isinstance(path, str | os.PathLike) and os.path.abspath(path).startswith(  # noqa: PTH100
                f"{folder}/"
            ):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return call(path, *rest, **more)

        return refuse

    for name in (
        "stat",
        "lstat",
        "open",
        "scandir",
        "listdir",
        "mkdir",
        "unlink",
        "rename",
        "replace",
    ):
        monkeypatch.setattr(os, name, refusing(getattr(os, name)))
    monkeypatch.setattr(io, "open", refusing(io.open))
    return folder / "inside"


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dive(tmp_path_factory.mktemp("places") / "dive", 2).root


def refused(words: list[str], place: str, dive: Path) -> None:
    code, said = command(*(place if word == X else word.replace(DIVE, str(dive)) for word in words))
    assert code in (1, 2, 3), said
    assert "Traceback" not in said
    assert said.splitlines()[-1].startswith("stereo-seecolor: ") or code == 3, said


@pytest.mark.parametrize(
    "words", COMMANDS, ids=[f"{i}-{words[0]}" for i, words in enumerate(COMMANDS)]
)
def test_a_folder_that_may_not_be_searched_is_one_line(
    locked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], dive: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(words, str(locked), dive)


@pytest.mark.parametrize("place", ["x" * 300, "", "/dev/full"])
@pytest.mark.parametrize(
    "words", COMMANDS, ids=[f"{i}-{words[0]}" for i, words in enumerate(COMMANDS)]
)
def test_a_place_that_cannot_be_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], place: str, dive: Path
) -> None:
    if (words[-2], place) in (("--log-file", "/dev/full"), ("--out", "")):
        pytest.skip("a device may hold a log, and the working folder results")
    monkeypatch.chdir(tmp_path)
    refused(words, place, dive)

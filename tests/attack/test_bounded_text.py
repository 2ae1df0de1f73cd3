"""Small files of text that took minutes, gigabytes, or the stack of the interpreter: each is
refused at once, in one line.
"""

import json
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from calibration import CalibrationError
from calibration.bounded_text import MAX_DEPTH, TooMuchError, load_json, load_yaml
from calibration.formats import load_rig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.extras.evaluation.charts.targets import read_targets
from stereo_seecolor.extras.fleet.campaign import CampaignFile
from stereo_seecolor.extras.fleet.cluster.job_file import JobFile
from stereo_seecolor.extras.reef.outline_files import read_outlines
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_format
from stereo_seecolor.run_folder.water_file import read_waters

ROOT = Path(__file__).resolve().parents[2]
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)
TEXTS = {
    "aliases": BOMB,
    "brackets": "[" * 200_000,
    "braces": '{"a":' * 100_000,
    "nested": "[" * 900 + "]" * 900,
    "digits": '{"jobs": ' + "9" * 5000 + "}",
    "underscores": "_" * 200_000,
    "parentheses": "time," + "(" * 200_000,
    "bytes": "\udcff",
}
Reader = Callable[[Path], object]
READERS: tuple[Reader, ...] = (
    CampaignFile.read,
    JobFile.read,
    load_config,
    read_trajectory,
    read_targets,
    lambda path: read_waters(path, ["a"]),
    lambda path: read_outlines(path, None),  # type: ignore[arg-type]  # refused before the map is asked
)


@pytest.mark.slow
@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS.keys())
@pytest.mark.parametrize("read", READERS)
def test_no_text_takes_long_or_ends_in_a_traceback(tmp_path: Path, read: Reader, text: str) -> None:
    path = tmp_path / "given.yaml"
    path.write_bytes(text.encode(errors="surrogateescape"))
    start_s = time.process_time()
    with pytest.raises(SeeColorError) as raised:
        read(path)
    assert time.process_time() - start_s < 5
    assert "\n" not in str(raised.value) and len(str(raised.value)) < 1000


@pytest.mark.slow
def test_a_long_line_is_soon_no_trajectory(tmp_path: Path) -> None:
    for name, text in TEXTS.items():
        if name != "bytes":
            (tmp_path / "poses.txt").write_text(text)
            assert trajectory_format(tmp_path / "poses.txt") is None


def test_what_people_write_is_read() -> None:
    assert load_yaml("a: &a [1, 2]\nb: *a") == {"a": [1, 2], "b": [1, 2]}
    assert load_json(b'{"a": [1, null, NaN, 1e-3]}')["a"][:2] == [1, None]
    assert len(load_json(json.dumps(list(range(300_000))))) == 300_000
    deep = "[" * MAX_DEPTH + "]" * MAX_DEPTH
    assert load_json(deep) == load_yaml(deep)
    with pytest.raises(TooMuchError):
        load_json(f"[{deep}]")
    with pytest.raises(TooMuchError):
        load_yaml(f"[{deep}]")


@pytest.mark.slow
def test_nothing_else_parses_text_of_users() -> None:
    """A reader of its own would have no bounds."""
    parsers = re.compile(
        r"\bjson\.loads?\(|\byaml\.(safe_)?load(_all)?\(|\byaml\.full_load|JSONDecoder|\bjson "
        r"import .*loads?\b"
    )
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for package in ("calibration", "stereo_seecolor")
        for path in (ROOT / package).rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if parsers.search(line) and "JSONDecodeError" not in line
    ]
    assert [line.partition(":")[0] for line in found] == 2 * ["calibration/bounded_text.py"], found


@pytest.mark.parametrize(
    "text", ["a" + ".a" * 60_000 + " = 1", "matrix = " + "[" * 50_000, "matrix = " + "{a=" * 40_000]
)
def test_toml_of_many_levels_is_refused_at_once(text: str, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(f"[cam_0]\n{text}\n")
    start_s = time.process_time()
    with pytest.raises(CalibrationError, match="levels"):
        load_rig(str(tmp_path / "rig.toml"))
    assert time.process_time() - start_s < 5

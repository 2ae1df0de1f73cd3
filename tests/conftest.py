"""Fixtures that many tests share."""

# ruff: noqa: E402
from stereo_seecolor.compute.library_threads import one_thread_in_libraries
from stereo_seecolor.compute.process import tune_gc

one_thread_in_libraries()  # as at the command line, and before what follows imports them
tune_gc()

import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from hypothesis import settings

from calibration import Camera, StereoRig
from calibration.formats import native
from stereo_seecolor.cli import main
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import PageTime, RunOptions
from stereo_seecolor.extras.synthetic import demo
from stereo_seecolor.extras.synthetic.demo import DemoResult
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.records import FrameRow

if TYPE_CHECKING:
    from mapping_scene import ReefFrames

# else every program that a test starts, and every process of tests, compiles all modules again
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def keep_to_one_core() -> None:
    """Where there are as many processes of tests as cores, each keeps to a core of its own, and so
    does what it starts: threads of one do not interrupt those of another.
    """
    process, processes = (
        os.environ.get(f"PYTEST_XDIST_WORKER{name}", "") for name in ("", "_COUNT")
    )
    if process and hasattr(os, "sched_setaffinity"):  # Linux alone
        cores = sorted(os.sched_getaffinity(0))
        if int(processes) == len(cores):
            os.sched_setaffinity(0, {cores[int(process.removeprefix("gw")) % len(cores)]})


keep_to_one_core()

# a run of three small pairs flushes 95 files; killed processes lose nothing of what is not flushed
os.fsync = lambda descriptor: None

# a busy machine is no failure; the same examples each time, so that what fails is the change's
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("other", deadline=None)  # --hypothesis-profile=other looks further
settings.load_profile("same")

ROOT = Path(__file__).resolve().parents[1]
REEF = ROOT / "data_samples" / "reef"
GIVEN_POSES = ("--poses", str(REEF / "trajectory.tum"), "--set", "mapping.poses=given")
REAL_DATA = Path(os.environ.get("STEREO_SEECOLOR_DATA", "not/given"))
"""Real frames, which are not in the repository: tests/DATA.md."""

Cli = Callable[..., tuple[int, str, str]]
CopyRun = Callable[..., Path]
SHARED_FIXTURES = (
    "sample_run",
    "real_dive",
    "finished_demo",
    "fused_dive",
    "by_day",
    "board_pairs",
    "dives",
    "web",
    "scene",
    "survey",
    "wheel",
    "shell",
    "installed",
)
"""They take seconds to make: tests that use one run in one process, of several that of the
first.
"""
SLOW_FIXTURES = {
    "sample_run",
    "real_dive",
    "waters_a_frame",
    "one_water",
    "mapped_by_poses",
    "finished_demo",
    "fused_dive",
    "dives",
    "flown_reef",
    "web",
}


def contents(out: Path) -> dict[str, bytes]:
    """All products of a run by name; frames.csv and run.json hold times, so they are left out."""
    products = ("corrected", "range", "range_std", "confidence", "mask", "clouds")
    found = {
        str(path.relative_to(out)): path.read_bytes()
        for product in products
        for path in (out / product).glob("*")
    }
    return found | {"water.json": (out / "water.json").read_bytes()}


def read_pixels(path: Path) -> np.ndarray:
    """The pixels of an image file as they are stored."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def make_files(root: Path, *names: str) -> Path:
    """Make empty files below ``root``, and the folders that they lie in; returns ``root``."""
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()
    return root


def group_of(item: pytest.Item) -> str:
    """The name of the group whose tests run in one process."""
    marker = item.get_closest_marker("xdist_group")
    assert marker is not None, item.nodeid
    return str(marker.args[0])


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that use what takes long to make are slow, and share it; those of a file share its
    own fixtures. Of several processes each begins with the groups of many slow tests; those of
    quick tests fill the time of the one that ends first. Windows leaves out what it cannot do.
    """
    for item in items:
        fixtures = set(getattr(item, "fixturenames", ()))
        if SLOW_FIXTURES & fixtures:
            item.add_marker(pytest.mark.slow)
        if item.get_closest_marker("xdist_group") is None:
            shared = next((name for name in SHARED_FIXTURES if name in fixtures), item.path.name)
            item.add_marker(pytest.mark.xdist_group(shared))
    if "PYTEST_XDIST_WORKER" in os.environ:
        slow = Counter(group_of(item) for item in items if item.get_closest_marker("slow"))
        items.sort(key=lambda item: -slow[group_of(item)])
    if sys.platform == "win32":
        for item in items:
            if item.get_closest_marker("posix"):
                item.add_marker(
                    pytest.mark.skip(
                        reason="needs named pipes, kills or limits, which Windows has not"
                    )
                )


@pytest.fixture(scope="session")
def web(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources of the page's program, with the libraries that it is built with."""
    if shutil.which("npm") is None:
        pytest.skip("Node is not installed: the page's program cannot be built")
    sources = Path(__file__).resolve().parents[1] / "web"
    work = tmp_path_factory.mktemp("page") / "web"
    shutil.copytree(sources, work, ignore=shutil.ignore_patterns("node_modules"))
    if (sources / "node_modules").is_dir():
        (work / "node_modules").symlink_to(sources / "node_modules")
    elif subprocess.run(
        ["npm", "ci", "--no-audit", "--no-fund"], cwd=work, capture_output=True
    ).returncode:
        pytest.skip("npm ci could not fetch the libraries of the page's program")
    return work


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Run a command in this process; (exit code, what was printed, what was said on standard
    error).
    """

    def call(*words: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["stereo-seecolor", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        return (int(end.value.code or 0), *capsys.readouterr())

    return call


def command(*words: str | Path) -> tuple[int, str]:
    """Run a command as typed, in this process; (exit code, what it printed and said)."""
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(said):
        patch.setattr(sys, "argv", ["stereo-seecolor", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
    code = end.value.code
    return (code if isinstance(code, int) else 0 if code is None else 1), said.getvalue()


@dataclass(frozen=True)
class SampleRun:
    """A dive that was run. printed: by the command."""

    out: Path
    printed: str

    def copy(self, to: Path) -> Path:
        """A copy to go on from: a run with other settings finds what stays the same, and does the
        rest.
        """
        return shutil.copytree(self.out, to)


@pytest.fixture(scope="session")
def sample_run(tmp_path_factory: pytest.TempPathFactory) -> SampleRun:
    """README's first command, as typed, once for all tests: they read it, or take a copy to write
    into.
    """
    block = re.search(
        r"^```sh\n(.*data_samples.*)\n```",
        (ROOT / "README.md").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    assert block
    words = shlex.split(block[1].split("&&")[-1])
    assert words[0] == ".venv/bin/stereo-seecolor"
    out = tmp_path_factory.mktemp("sample_dive") / "out"
    words[words.index("--out") + 1] = str(out)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        code, printed = command(*words[1:])
    assert code == 0, printed
    return SampleRun(out, printed)


@pytest.fixture(scope="session")
def waters_a_frame(sample_run: SampleRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of the sample dive with a water for each frame; to be read only."""
    out = sample_run.copy(tmp_path_factory.mktemp("waters_a_frame") / "out")
    sides = ("--left", REEF / "left", "--right", REEF / "right", "--calib", REEF / "cam.yaml")
    code, said = command("run", *sides, "--out", out, "--set", "color.lock=frame")
    assert code == 0, said
    return out


@pytest.fixture(scope="session")
def one_water(sample_run: SampleRun, tmp_path_factory: pytest.TempPathFactory) -> SampleRun:
    """The sample dive with one water for all frames; tests read it, or take a copy."""
    out = sample_run.copy(tmp_path_factory.mktemp("one_water") / "out")
    sides = ("--left", REEF / "left", "--right", REEF / "right", "--calib", REEF / "cam.yaml")
    code, said = command("run", *sides, "--out", out, "--set", "color.lock=survey")
    assert code == 0, said
    return SampleRun(out, said)


@pytest.fixture(scope="session")
def real_dive(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> SampleRun:
    """The real dive in half its size, refined and run; tests read it, or take a copy."""
    from small_dives import write_half_of_the_real_dive

    folder = tmp_path_factory.mktemp("real_dive")
    write_half_of_the_real_dive(real_data, folder)
    sides = ("--left", folder / "left", "--right", folder / "right", "--calib", folder / "cam.yaml")
    code, said = command("run", "--refine", *sides, "--out", folder / "out")
    assert code == 0, said
    return SampleRun(folder / "out", said)


@pytest.fixture(scope="session")
def mapped_by_poses(sample_run: SampleRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of the sample dive with the map by its given poses, which the page does not
    show; to be read only.
    """
    out = sample_run.copy(tmp_path_factory.mktemp("mapped_by_poses") / "out")
    config = load_config(out / "run.json", ["mapping.poses=given"])
    assert not fuse(out, REEF / "trajectory.tum", config).warnings
    return out


@pytest.fixture(scope="session")
def finished_demo(tmp_path_factory: pytest.TempPathFactory) -> DemoResult:
    """The demo in small pictures, rendered and run once, in FOLDER/out of FOLDER/dive; to be read
    only.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "SurveySpec", partial(SurveySpec, image_size=(256, 192)))
        return demo.demo(tmp_path_factory.mktemp("demo"))


@pytest.fixture(scope="session")
def flown_reef() -> "ReefFrames":
    """Twelve frames with known ranges and poses, in two lines over a synthetic reef; to be read
    only.
    """
    from mapping_scene import ReefFrames

    return ReefFrames(SurveySpec(pairs=12, lines=2, image_size=(256, 208), seed=3), noise_px=0.1)


@pytest.fixture
def demo_at_hand(finished_demo: DemoResult, monkeypatch: pytest.MonkeyPatch) -> DemoResult:
    """The command ``demo`` gives this one."""
    monkeypatch.setattr(demo, "demo", lambda *_: finished_demo)
    return finished_demo


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real frames, stereo pairs and chessboards; skips where it is absent."""
    if not REAL_DATA.is_dir():
        pytest.skip(
            "real frames are not in the repository: STEREO_SEECOLOR_DATA names their folder "
            "(tests/DATA.md)"
        )
    return REAL_DATA


class AtPair:
    """A listener that raises an error, or calls a function, at the nth pair that it hears of."""

    def __init__(self, number: int, what: type[BaseException] | Callable[[], object]) -> None:
        self._left, self._what = number, what

    def begin(self, stage: str, total: int) -> None:
        """Nothing."""

    def advance(self, row: FrameRow) -> None:
        self._left -= 1
        if self._left == 0 and isinstance(self._what, type):
            raise self._what
        if self._left == 0:
            self._what()


@dataclass(frozen=True)
class Dive:
    """A small dive on disk: two folders, a calibration, and the true range of all its pairs."""

    root: Path
    range_m: np.ndarray

    def command(self, out: Path, *more: str, command: str = "run") -> list[str]:
        sides = ["--left", str(self.root / "L"), "--right", str(self.root / "R")]
        return [command, *sides, "--calib", str(self.root / "cam.yaml"), "--out", str(out), *more]


FOCAL_PX, BASELINE_M, WIDTH, HEIGHT = 150.0, 0.1, 176, 128


@pytest.fixture
def make_dive(tmp_path: Path) -> Callable[..., Dive]:
    """``write_dive`` into a folder of the test's own."""
    return partial(write_dive, tmp_path / "dive")


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The output folder of a run of ``make_dive(pairs)`` with some settings, made once for all
    tests; to be read only.
    """

    @cache
    def finished(pairs: int = 3, *settings: str, page: PageTime = "end") -> Path:
        folder = tmp_path_factory.mktemp("finished")
        root = write_dive(folder / "dive", pairs).root
        sides, config = (root / "L", root / "R", root / "cam.yaml"), load_config(None, settings)
        assert run(*sides, folder / "out", config, RunOptions(page=page)).all_done
        return folder / "out"

    return finished


@pytest.fixture
def copy_run(finished_run: Callable[..., Path]) -> CopyRun:
    """Puts a copy of ``finished_run`` into a folder: what a run of that dive would write there."""
    return lambda out, *made, **how: shutil.copytree(finished_run(*made, **how), out)


@pytest.fixture(scope="session")
def fused_dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``out``, three pairs run and fused, and ``poses.tum``; to be read only."""
    folder = tmp_path_factory.mktemp("fused")
    dive, out, poses = write_dive(folder / "dive", 3), folder / "out", folder / "poses.tum"
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    run(*sides, out, options=RunOptions(workers=1))
    poses.write_text("".join(f"{number} {0.05 * number} 0 0 0 0 0 1\n" for number in range(3)))
    fuse(out, poses)
    return folder


def write_dive(root: Path, pairs: int = 3, seed: int = 0, dtype: type = np.uint8) -> Dive:
    """Write a dive of rectified pairs: a slope from 1 to 2 m, seen through green water. Cheap, and
    its range is known.
    """
    for side in "LR":
        (root / side).mkdir(parents=True)
    K = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]])
    T = np.eye(4)
    T[0, 3] = -BASELINE_M
    camera = Camera(K, np.zeros(0), (WIDTH, HEIGHT))
    native.write(StereoRig(camera, camera, T), root / "cam.yaml")
    for i in range(pairs):
        for side, image in zip("LR", _pictures(seed * 1000 + i, dtype), strict=True):
            (root / side / f"{i:04d}.png").write_bytes(image)
    return Dive(root, _slope_m()[1].copy())


@cache
def _slope_m() -> tuple[np.ndarray, np.ndarray]:
    """Depth and range of the slope of all dives."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    depth_m = np.linspace(2, 1, HEIGHT, dtype=np.float32)[:, None] * np.ones((1, WIDTH), np.float32)
    ray = np.sqrt(1 + ((x - WIDTH / 2) / FOCAL_PX) ** 2 + ((y - HEIGHT / 2) / FOCAL_PX) ** 2)
    return depth_m, depth_m * ray


@cache
def _pictures(seed: int, dtype: type) -> list[bytes]:
    """The left and the right image of a pair of such a dive, as PNG files."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    depth_m, range_m = _slope_m()
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(
        rng.uniform(0, 1.2, (HEIGHT, WIDTH + 32, 3)).astype(np.float32), (0, 0), 0.8
    )
    reef = np.clip(texture * 2 - 0.6, 0, 1)
    attenuation = np.exp(-range_m[..., None] * np.array([0.5, 0.1, 0.15]))
    pictures = []
    for shift in (1, 0):
        image = cv2.remap(
            reef,
            x + 8 - shift * FOCAL_PX * BASELINE_M / depth_m,
            y,
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REFLECT,
        )
        water = np.clip(image * attenuation + 0.15 * (1 - attenuation), 0, 1)
        full = np.iinfo(dtype).max
        encoded = cv2.imencode(".png", np.round(water * full).astype(dtype)[..., ::-1])[1]
        pictures.append(encoded.tobytes())
    return pictures

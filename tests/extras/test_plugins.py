"""Packages add commands, formats, engines and color methods by entry points, as the page on them
shows; the core loads none of its own extras.
"""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from conftest import Cli
from mapping_scene import PAIR
from small_dives import write_short_reef

from calibration import CalibrationError
from calibration import plugins as everywhere
from calibration.formats import format_name, load_rig
from calibration.formats.calibration_format import added_formats as calibration_formats
from stereo_seecolor import plugins
from stereo_seecolor.cli import app
from stereo_seecolor.commands.doctor import CORE, EXTRAS
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.errors import PluginError
from stereo_seecolor.extras.export.command import export_formats
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.inputs.opened_paths import container_of
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.inputs.trajectories.trajectory_format import (
    added_formats as trajectory_formats,
)
from stereo_seecolor.mapping.surface.engines import engine
from stereo_seecolor.matching.gray import GrayPair
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.records import StereoFrame
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.water_file import read_waters

PROJECT_FILE = tomllib.loads(
    (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
)["project"]
LOADED_WHERE_NEEDED = {"rich", "threadpoolctl"}
"""rich: on a terminal. threadpoolctl: where numpy was imported before the program."""

PROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"

[project]
name = "reef-notes"
version = "1.0"

[project.entry-points."stereo_seecolor.engines"]
raised = "reef_notes:fuse_raised"

[tool.setuptools]
py-modules = ["reef_notes"]
"""

MORE_ENTRIES = {
    'note = "reef_notes:note"': 'lost = "reef_notes.not_there:lost"',
    'blocks = "reef_notes:BlockMatching"': 'level = "reef_notes:Level"',
    'slope = "reef_notes:fit"': 'nothing = "reef_notes:fit_nothing"',
}
"""Entries of the page, and what stands below each here."""

MODULE = """
from dataclasses import replace

from stereo_seecolor.mapping.surface.own_engine import fuse_tile


def fuse_raised(tile, tiling, frames, geometry):
    surface = fuse_tile(tile, tiling, frames, geometry)
    return replace(surface, points_m=surface.points_m + np.float32([0, 0, 1]))


def fit_nothing(table, config, start=None):
    return None


class Level:
    refined = True

    def __init__(self, config, lowest_px, highest_px):
        self.disparity_px = (lowest_px + highest_px) // 2

    def find(self, frame, pair):
        found = np.full(frame.left.shape[:2], self.disparity_px, np.float32)
        return MatchedDisparity(found, found, np.full_like(found, 0.5))
"""


def documented(language: str) -> str:
    """All blocks of a language on the page about packages."""
    page = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")
    return "\n".join(re.findall(rf"^```{language}\n(.*?)^```", page, re.DOTALL | re.MULTILINE))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that a package of somebody else is installed in: that of the page, with more in
    it.
    """
    root = tmp_path_factory.mktemp("reef-notes")
    entries = documented("toml")
    for entry, more in MORE_ENTRIES.items():
        assert entry in entries
        entries = entries.replace(entry, f"{entry}\n{more}")
    (root / "pyproject.toml").write_text(PROJECT + entries)
    (root / "reef_notes.py").write_text(documented("python") + MODULE)
    options = (
        "--no-deps",
        "--no-index",
        "--no-build-isolation",
        "--quiet",
        "--target",
        str(root / "installed"),
    )
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, str(root)],
        check=True,
        capture_output=True,
    )
    return root / "installed"


@pytest.fixture
def installed(site: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli) -> Iterator[Cli]:
    """Runs a command where that package is installed."""
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setenv("TERM", "dumb")
    forget_packages()
    yield cli
    forget_packages()
    sys.modules.pop("reef_notes", None)


def forget_packages() -> None:
    """What is installed is looked for again."""
    everywhere._of_all_packages.cache_clear()
    everywhere.added.cache_clear()


@pytest.mark.slow
def test_a_command_of_another_package_runs_in_a_program_of_its_own(
    site: Path, fused_dive: Path
) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "stereo_seecolor", "note", fused_dive / "out"],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(site)},
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "noted out\n", "")


@pytest.mark.slow
def test_commands_of_another_package_are_in_the_help(installed: Cli) -> None:
    code, printed, said = installed("--help")
    assert code == 0
    assert " Notes " in printed and "Print the name of a run." in printed
    assert printed.index(" run ") < printed.index(" config ") < printed.index(" export ")
    assert said.startswith(
        "lost: the package reef-notes, which adds it to stereo_seecolor.commands, cannot be loaded"
    )
    code, _, said = installed("lost")
    assert code == 1
    assert "cannot be loaded" in said and "Traceback" not in said


@pytest.mark.slow
def test_an_export_format_of_another_package_is_written(
    installed: Cli, fused_dive: Path, tmp_path: Path
) -> None:
    code, printed, _ = installed("export", "--list")
    assert code == 0
    assert "names        the names of the frames: any editor" in printed.splitlines()
    code, _, said = installed(
        "export", fused_dive / "out", "--to", "names", "--out", tmp_path / "names"
    )
    assert (code, said) == (0, "")
    assert (tmp_path / "names" / "names.txt").read_text().split()[0] == "0000"


@pytest.mark.slow
@pytest.mark.usefixtures("installed")
def test_a_trajectory_format_of_another_package_is_read(tmp_path: Path) -> None:
    log = tmp_path / "track.txt"
    log.write_text("# tank log\na.png 1 2 3\nb.png 4 5 6\n")
    track = read_trajectory(log)
    assert track.names == ("a.png", "b.png")
    np.testing.assert_array_equal(track.T_world_camera[1, :3, 3], [4, 5, 6])


@pytest.mark.slow
@pytest.mark.usefixtures("installed")
def test_a_calibration_format_of_another_package_is_read(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("tank_rig: {size: [640, 480], focal_px: 500, baseline_mm: 120}")
    assert format_name(rig) == "tank"
    assert load_rig(rig).baseline_m == pytest.approx(0.12)


@pytest.mark.slow
def test_an_engine_of_another_package_fuses_the_map(
    installed: Cli, fused_dive: Path, tmp_path: Path
) -> None:
    out = shutil.copytree(fused_dive / "out", tmp_path / "out")
    words = ("fuse", out, "--poses", fused_dive / "poses.tum")
    code, _, said = installed(*words, "--set", "mapping.engine=raised")
    assert code == 3 and "poses" in said, said  # they are not those of the pictures
    assert json.loads((out / "map/map.json").read_text())["engine"] == "raised"
    raised, ours = (
        read_vertices(folder / "map/cloud.ply")["position"] for folder in (out, fused_dive / "out")
    )
    np.testing.assert_allclose(raised - ours, np.broadcast_to([0, 0, 1], ours.shape), atol=1e-5)


@pytest.mark.slow
def test_a_matching_engine_of_another_package_gives_the_ranges(
    installed: Cli, tmp_path: Path
) -> None:
    write_short_reef(tmp_path)
    sides = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    out = tmp_path / "out"
    rest = ("--calib", tmp_path / "cam.yaml", "--out", out, "--progress", "none")
    settings = ("--set", "matching.engine=level", "--set", "matching.min_confidence=0")
    code, _, said = installed("run", *sides, *rest, *settings)
    assert code == 0, said
    run = open_run(out)
    range_m = run.frames[0].read("range")
    depth_m = range_m[np.isfinite(range_m)] / run.geometry.ray_length[np.isfinite(range_m)]
    np.testing.assert_allclose(depth_m, np.median(depth_m), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.usefixtures("installed")
def test_the_matcher_of_the_page_finds_a_shift() -> None:
    texture = np.random.default_rng(0).integers(0, 255, (60, 200, 1), np.uint8).repeat(3, axis=2)
    frame = StereoFrame("a", texture[:, :160], texture[:, 12:172])
    matcher = importlib.import_module("reef_notes").BlockMatching(None, 3, 40)
    found = matcher.find(frame, GrayPair.from_frame(frame, 2)).disparity
    assert np.median(found[8:-8, 20:-8]) == 12 and np.isfinite(found[:, :40]).any()


@pytest.mark.slow
def test_a_color_method_of_another_package_fits_the_water(installed: Cli, tmp_path: Path) -> None:
    words = ("correct", "--images", tmp_path / "images", "--range", tmp_path / "range")
    range_m = np.linspace(1, 4, 320 * 240, dtype=np.float32).reshape(240, 320)
    light = 0.6 * np.exp(-range_m[..., None] * np.array([0.05, 0.1, 0.3]))  # B, G, R
    image = np.round(255 * encode_srgb(light)).astype(np.uint8)
    for folder, content in (("images", image), ("range", range_m)):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "a.tiff"), content)
    method = ("--progress", "none", "--set")
    code, _, said = installed(*words, "--out", tmp_path / "out", *method, "color.method=slope")
    assert code == 0, said
    water = next(iter(read_waters(tmp_path / "out/water.json", ["a"]).values()))
    np.testing.assert_allclose(water.y, [0.3, 0.1, 0.05], rtol=0.1)
    code, _, said = installed(*words, "--out", tmp_path / "other", *method, "color.method=nothing")
    assert code == 1
    assert (
        "the package reef-notes adds an object of type NoneType to stereo_seecolor.color_methods"
        in said
    )


@pytest.mark.parametrize(
    ("setting", "known"),
    [
        ("mapping.engine", "tiles, open3d"),
        ("matching.engine", "sgm, opencv, an .onnx file"),
        ("color.method", "robust, paper"),
    ],
    ids=["maps", "matching", "color"],
)
def test_an_engine_that_no_package_adds_is_refused_with_those_that_are_known(
    cli: Cli, setting: str, known: str
) -> None:
    code, _, said = cli("config", "--set", f"{setting}=voxblox")
    assert code == 1
    assert (
        said == f"stereo-seecolor: --set: {setting}: no installed package adds this "
        f"{setting.partition('.')[2]}; known are {known} (got 'voxblox')\n"
    )


def test_a_run_made_with_an_engine_that_is_not_installed_here_is_still_read(
    fused_dive: Path, tmp_path: Path
) -> None:
    out = shutil.copytree(fused_dive / "out", tmp_path / "out")
    text = (out / "run.json").read_text()
    (out / "run.json").write_text(text.replace('"engine": "tiles"', '"engine": "voxblox"'))
    assert open_run(out).config.mapping.engine == "voxblox"
    with pytest.raises(PluginError, match=r"voxblox: no installed package adds it to .*engines"):
        fuse(out)


@pytest.mark.parametrize("group", PROJECT_FILE["entry-points"])
def test_what_this_package_adds_is_what_its_project_file_says(group: str) -> None:
    added = {name: entry.value for name, entry in everywhere.added(group).items()}
    said = PROJECT_FILE["entry-points"][group].items()
    assert said <= added.items(), "install the package again: pip install -e ."


def test_all_formats_of_this_package_are_formats() -> None:
    assert {"kitti", "seagis"} <= calibration_formats().keys()
    assert "oplab" in {one.title for one in trajectory_formats()}


def test_a_part_that_no_package_adds_is_named_with_those_that_are_known() -> None:
    with pytest.raises(
        PluginError,
        match=r"^fax: no installed package adds it to stereo_seecolor.recordings \(known: mcap\)$",
    ):
        plugins.load("recordings", "fax")


def test_a_cluster_of_an_unknown_kind_is_named(cli: Cli, tmp_path: Path) -> None:
    sides = ("--left", tmp_path, "--right", tmp_path, "--calib", "cam.yaml")
    code, _, said = cli("run", *sides, "--out", tmp_path / "out", "--cluster", "cloud:4")
    assert code == 1
    assert "--cluster cloud:4: is not a cluster: give one of htcondor, local, " in said
    assert not (tmp_path / "out").exists()


PAPERS_METHOD = """
import numpy as np
from stereo_seecolor.color import ColorConfig, Corrector
image, range_m = np.full((9, 9, 3), 90, np.uint8), np.linspace(1, 3, 81, dtype=np.float32)
Corrector(ColorConfig(method="paper")).fit_frame(image, range_m.reshape(9, 9))
"""


@pytest.mark.slow
def test_a_run_with_a_map_loads_no_extra_and_all_that_the_base_installs(tmp_path: Path) -> None:
    code = "import sys, stereo_seecolor; from stereo_seecolor.cli import main\n"
    code += "try: main()\nexcept SystemExit as end: print(end.code)\n"
    code += PAPERS_METHOD
    code += "print([name for name in sys.modules if name.startswith('stereo_seecolor.extras')])\n"
    code += "print(*(name for name in sys.modules if '.' not in name))"
    write_short_reef(tmp_path, range(4, 6))
    sides = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    rest = ("--calib", tmp_path / "cam.yaml", "--out", tmp_path / "out", "--progress", "none")
    words = ("run", *map(str, (*sides, *rest)), "--fuse")
    ended = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert ended.stdout.splitlines()[-3:-1] == ["0", "[]"], ended.stderr
    loaded = set(ended.stdout.splitlines()[-1].split())
    modules = {library.distribution: library.module for library in (*CORE, *EXTRAS)}
    base = {modules[re.split(r"[\[>; ]", wanted)[0]] for wanted in PROJECT_FILE["dependencies"]}
    assert base - loaded <= LOADED_WHERE_NEEDED
    assert not loaded & ({*modules.values()} - base - {"lazrs"})  # which is the base's laspy[lazrs]
    assert "sympy" not in loaded  # by torch.optim and torch.func, which take a second


class Entry:
    """An entry point of a package of somebody else that hands over an object."""

    dist = SimpleNamespace(name="reef-notes")

    def __init__(self, found: object) -> None:
        self.load = lambda: found


@pytest.mark.parametrize(
    ("group", "found", "use", "wanted"),
    [
        (
            "commands",
            print,
            lambda: app._needed(["x"]),
            "builtin_function_or_method to stereo_seecolor.commands, not of the class Command",
        ),
        (
            "exports",
            "names",
            export_formats,
            "an object of type str to stereo_seecolor.exports, not of the class ExportFormat",
        ),
        (
            "trajectory_formats",
            SimpleNamespace(recognizes=bool),
            lambda: read_trajectory(Path("x")),
            "to stereo_seecolor.trajectory_formats, not of the class TextFormat or FileFormat",
        ),
        (
            "calibration.formats",
            print,
            lambda: load_rig(__file__),
            "to calibration.formats, not of the class RigFormat or CameraFormat",
        ),
        (
            "engines",
            3,
            lambda: engine("x"),
            "type int to stereo_seecolor.engines, which cannot be called",
        ),
        (
            "matching_engines",
            lambda *_: 3,
            lambda: Matcher(PAIR, MatchingConfig(engine="x")),
            "type int to stereo_seecolor.matching_engines, which has no function 'find'",
        ),
        (
            "containers",
            None,
            lambda: container_of(Path("a.x")),
            "type NoneType to stereo_seecolor.containers, which cannot be called",
        ),
    ],
)
def test_what_is_not_of_the_kind_of_its_group_is_named_with_its_package(
    monkeypatch: pytest.MonkeyPatch,
    group: str,
    found: object,
    use: Callable[[], object],
    wanted: str,
) -> None:
    whole = group if "." in group else f"stereo_seecolor.{group}"
    known = {whole: {"x": Entry(found)}}
    monkeypatch.setattr("calibration.plugins.added", lambda group: known.get(group, {}))
    with pytest.raises((PluginError, CalibrationError)) as raised:
        use()
    message = str(raised.value)
    assert message.startswith("x: the package reef-notes adds an object of type ")
    assert message.endswith(f"{wanted}: see docs/extending.md")

"""What is installed is these two packages and the page, and nothing more, and the documentation
builds without a warning.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest
import yaml
from conftest import SampleRun

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("calibration", "stereo_seecolor")


def test_two_packages_are_installed() -> None:
    assert set((distribution("stereo-seecolor").read_text("top_level.txt") or "").split()) == set(
        PACKAGES
    )


def test_every_folder_of_code_is_a_package() -> None:
    for package in PACKAGES:
        folders = {path.parent for path in (ROOT / package).rglob("*.py")}
        assert all((folder / "__init__.py").exists() for folder in folders)


@pytest.mark.slow
def test_calibration_needs_nothing_of_the_program() -> None:
    code = (
        "import sys, calibration, calibration.calibrate, calibration.formats; "
        "print(sorted(sys.modules))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert not [name for name in ("'stereo_seecolor'", "'torch'", "'open3d'") if name in loaded]


def test_no_test_skips_for_a_missing_package() -> None:
    skipping = [
        path.name
        for path in (ROOT / "tests").rglob("*.py")
        if re.search(r"pytest\.importorskip\(", path.read_text("utf-8"))
    ]
    assert not skipping, "put the package into the dev extra instead"


def test_every_exception_from_coverage_has_a_reason() -> None:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            bare = [
                line
                for line in path.read_text("utf-8").splitlines()
                if re.search(r"pragma: no cover(?!: \w)", line)
            ]
            assert not bare, f"{path}: write '# pragma: no cover: REASON'"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the sources: setuptools leaves a build folder where it
    works.
    """
    root = tmp_path_factory.mktemp("wheel")
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, root / file)
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(root), str(root))
    return next(root.glob("*.whl"))


@pytest.mark.slow
def test_wheel_holds_both_packages_whole_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        license_files = [name for name in archive.namelist() if name.endswith("licenses/LICENSE")]
    sources = {
        str(path.relative_to(ROOT).as_posix())
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    page = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "stereo_seecolor/report/static").iterdir()
    }
    page.add("stereo_seecolor/extras/streams/live/preview.html")
    page.add("stereo_seecolor/color/fitting/scene_colors.json")
    assert names == sources | page | {f"{package}/py.typed" for package in PACKAGES}
    assert license_files


HELP_OF_ALL = """
import contextlib, io, sys
import stereo_seecolor
from stereo_seecolor.cli import main
from stereo_seecolor.cli.app import every_command

def printed(*words):
    sys.argv = ["stereo-seecolor", *words]
    with contextlib.redirect_stdout(io.StringIO()) as text:
        try:
            main()
        except SystemExit as end:
            assert not end.code, (words, end.code)
    return text.getvalue()

assert stereo_seecolor.__file__.startswith(sys.argv[1]), stereo_seecolor.__file__
print(printed("--version").strip())
for name in every_command():
    assert "Usage:" in printed(name, "--help"), name
    print(name)
"""
"""Prints the version, and the name of each command that prints its help, from the installed files
alone.
"""


@pytest.mark.slow
def test_every_command_of_the_installed_wheel_prints_its_help(wheel: Path, tmp_path: Path) -> None:
    """And the program its version; tests/install/test_reinstall.py has pip install it."""
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    version, *printed = subprocess.run(
        [sys.executable, "-c", HELP_OF_ALL, str(site)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert version == wheel.name.split("-")[1]
    assert {"run", "check", "inspect", "export", "live", "doctor"} <= set(printed)
    assert len(printed) >= 25


def test_version_date_and_title_of_the_release_agree() -> None:
    """Of the package, the citation, the archive and the changelog."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    archive = json.loads((ROOT / ".zenodo.json").read_text("utf-8"))
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    released, date = re.findall(r"^## ([\d.]+) - ([\d-]+)$", changes, flags=re.MULTILINE)[0]
    assert citation["version"] == archive["version"] == released
    assert str(citation["date-released"]) == archive["publication_date"] == date
    # between releases the package is that of the next one, with .dev0
    assert project["version"] == released or project["version"].endswith(".dev0")
    assert citation["title"] == archive["title"] == project["name"]
    assert citation["license"] == archive["license"] == project["license"]
    names = [author["name"] for author in citation["authors"]]
    assert names == [author["name"] for author in archive["creators"]]
    assert names == [author["name"] for author in project["authors"]]
    cited = {each["doi"] for each in citation["references"]}
    assert cited == {each["identifier"] for each in archive["related_identifiers"]}


def pip(*arguments: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    finished = subprocess.run(command, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr


@pytest.mark.slow
def test_documentation_builds_with_the_page_of_the_sample_dive_in_it(
    sample_run: SampleRun, tmp_path: Path
) -> None:
    sample = f"sample_page={sample_run.out}"
    built = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            "-q",
            "-W",
            "--keep-going",
            "-D",
            sample,
            str(ROOT / "docs"),
            str(tmp_path),
        ],
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    settings = (tmp_path / "configuration.html").read_text("utf-8")
    assert "color.lock" in settings
    assert "Folder of left images" in (tmp_path / "commands.html").read_text("utf-8")
    assert 'href="sample/index.html"' in (tmp_path / "page.html").read_text("utf-8")
    shown = {path.name for path in (tmp_path / "sample/page").iterdir()}
    assert (tmp_path / "sample/index.html").is_file() and {
        "page.js",
        "map.js",
        "dive.js",
        "thumbnails",
    } <= shown

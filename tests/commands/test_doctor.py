"""The command doctor: what is there, what is missing, what is lost without, and the command that
installs it.
"""

import tomllib
from pathlib import Path

import pytest

from stereo_seecolor.cli.machine_commands import doctor_text
from stereo_seecolor.commands import doctor as module
from stereo_seecolor.commands.doctor import CORE, EXTRAS, Library, doctor, examine

ROOT = Path(__file__).resolve().parents[2]


def test_a_missing_library_names_what_is_lost_and_the_command() -> None:
    finding = examine(Library("no_such_module", "no-such-module", "geo", "no GeoTIFF"))
    assert (finding.ok, finding.needed, finding.detail, finding.without) == (
        False,
        False,
        "not installed",
        "no GeoTIFF",
    )
    assert finding.fix == "pip install -c constraints.txt '.[geo]'"
    assert examine(Library("no_such_module", "no-such-module")).needed


def test_a_library_that_is_broken_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_module.py").write_text(
        "raise OSError('libGL.so.1: cannot open\\nshared object file')"
    )
    monkeypatch.syspath_prepend(tmp_path)
    finding = examine(Library("broken_module", "broken"))
    assert (finding.ok, finding.detail) == (False, "libGL.so.1: cannot open shared object file")


def test_the_report_is_ready_where_all_that_is_needed_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        module, "EXTRAS", (Library("no_such_module", "x", "slam", "no loop closure"),)
    )
    assert doctor().ready
    monkeypatch.setattr(module, "CORE", (Library("no_such_module", "x"),))
    assert not doctor().ready


def test_open3d_without_its_system_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    def examine_nothing(library: Library) -> module.Finding:
        return module.Finding(
            library.module,
            library.module != "open3d",
            "libGL.so.1 is missing",
            without=library.without,
        )

    monkeypatch.setattr(module, "examine", examine_nothing)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delattr("os.geteuid", raising=False)  # as on Windows
    finding = next(finding for finding in doctor().findings if finding.what == "open3d")
    assert "apt-get install" in finding.fix
    assert (
        finding.without
        == "no fusion by Open3D (mapping.engine=open3d), no map window (view --window)"
    )
    monkeypatch.setattr("sys.platform", "win32")
    assert not next(finding for finding in doctor().findings if finding.what == "open3d").fix


def test_every_dependency_of_a_user_is_looked_at() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    looked_at = {library.distribution for library in (*CORE, *EXTRAS)} | {"open3d-cpu"}
    extras = {
        name: wanted
        for name, wanted in project["optional-dependencies"].items()
        if name not in ("dev", "docs")
    }
    wanted = [
        *project["dependencies"],
        *(requirement for requirements in extras.values() for requirement in requirements),
    ]
    names = {requirement.split(">")[0].split("[")[0].strip() for requirement in wanted}
    assert names <= looked_at
    assert {library.extra for library in EXTRAS} == set(extras)


def test_the_text_tells_what_is_optional_from_what_stops_a_run() -> None:
    optional = module.Finding(
        "rerun", False, "not installed", without="a plainer window", fix="pip install rerun-sdk"
    )
    needed = module.Finding("numba", False, "not installed", needed=True)
    assert doctor_text([optional]).splitlines()[0] == "optional  rerun: not installed"
    assert doctor_text([optional]).splitlines()[-1].startswith("ready")
    assert doctor_text([optional, needed]).splitlines()[-2:] == [
        "MISSING   numba: not installed",
        "not ready: numba must be installed first",
    ]

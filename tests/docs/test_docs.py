"""What the documentation tells people to type does what it says, and the generated pages are those
of this program.
"""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from calibration_boards import photograph_board
from small_dives import write_half_pictures, write_short_reef

from stereo_seecolor.cli import main
from stereo_seecolor.config.file import RENAMED, known_keys
from stereo_seecolor.report.texts import texts

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("*.md"), *(DOCS / "lab").glob("*.md")])
TEXTS = [*PAGES, *(path for path in sorted(ROOT.glob("*.md")) if path.name != "CHANGELOG.md")]
"""What holds of the program as it is; the changelog names what is gone."""
DIVE = Path("data_samples/reef")
FRAMES = range(5, 8)
"""One of the first line and two of the second, which overlap: enough for everything."""

AIR = "air.yaml"
FINISHED = (0, None)
SHOWN_ONLY = ("view", "bag-info", "measure", "campaign", "sync", "markers")
"""Commands that open a window, or need files that a user has: only their help is asked for."""

ONLY_PRINT = ("evaluate", "inspect", "check", "doctor")
"""Commands that write nothing (but ``check --refine``), of the shorter dive always the same."""

ONLY_READ = ("compare", "metrics", "synthesize")
"""Commands whose results go to --out alone: what they read was made by the same lines before."""

INTO_A_RUN = ("fuse", "report", "water")
"""Commands that add to the folder of a run, which they name first."""

MOST_BYTES = 200_000


def blocks(path: Path) -> list[tuple[str, str]]:
    """(language, content) of every code block of a page."""
    return re.findall(
        r"^```(\w+)\n(.*?)^```", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )


def runnable(path: Path) -> list[tuple[str, str]]:
    return [
        (language, content) for language, content in blocks(path) if language in ("sh", "python")
    ]


def short_dive(root: Path) -> None:
    """A folder that looks like a checkout, with a shorter sample dive in it, in small pictures."""
    write_short_reef(root / DIVE, FRAMES)
    for kind in ("range", "color", "visible"):
        files = sorted((ROOT / DIVE / "truth" / kind).iterdir())[FRAMES.start : FRAMES.stop]
        write_half_pictures(files, root / DIVE / "truth" / kind)
    for file in ("trajectory.tum", "truth/water.json", "truth/surface.npz"):
        shutil.copy(ROOT / DIVE / file, root / DIVE / file)


class Shell:
    """Runs the lines of shell blocks, and keeps what they made of the shorter dive.

    Pages repeat each other's lines: what was typed before, into a folder that was not there, is
    copied instead of made again, as is what was done to such a folder since, and what only prints
    is not printed again. Any other ``run`` goes on from the run with the defaults, so that only
    what its settings change is done. fresh: a short checkout without what was made.
    """

    FIRST = "stereo-seecolor run --left left --right right --calib cam.yaml --out out"

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._made: dict[tuple[str, ...], Path] = {}
        self._lines: dict[Path, tuple[str, ...]] = {}
        """That made what is in a folder of the test that runs."""
        self._printed: set[str] = set()
        self.fresh = folder / "fresh"
        short_dive(self.fresh)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(shutil.copytree(self.fresh, folder / "first") / DIVE)
            self.run(self.FIRST, patch)

    def run(self, line: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """Run one line: a change of the folder, or the program."""
        words = shlex.split(line, comments=True)
        if words[0] == "cd":
            monkeypatch.chdir(words[1])
            return
        assert words[0] == "stereo-seecolor", (
            f"{line}: blocks of 'sh' hold only commands that the tests can run; use 'bash'"
        )
        line = shlex.join(words)
        if words[1] == "fuse" and (Path(words[2]) / "map").exists():  # from the same poses
            return
        if line in self._printed:
            missing = [
                word for word in words[2:] if not word.startswith("-") and not Path(word).exists()
            ]
            assert not missing, line
            return
        if words[1] in ONLY_PRINT and "--refine" not in words:
            self._printed.add(line)
        again = ("--left left" in line or words[1] in ONLY_READ) and "board" not in line
        if again and "--out" in words:
            out = Path(words[words.index("--out") + 1]).absolute()
        elif words[1] in INTO_A_RUN:
            out = Path(words[2]).absolute()
        else:
            out = None
        if out is None or (out.exists() and out not in self._lines):
            _program(words, monkeypatch)
            return
        lines = (*self._lines.get(out, ()), line)
        if lines in self._made:
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(self._made[lines], out)
        else:
            if words[1] == "run" and "--shard" not in words and self._made and not out.exists():
                shutil.copytree(self._made[(self.FIRST,)], out)
            _program(words, monkeypatch)
            place = self._folder / f"made_{len(self._made)}"
            self._made[lines] = Path(shutil.copytree(out, place))
        self._lines[out] = lines


def _program(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", [*words[:2], "--help"] if words[1] in SHOWN_ONLY else words)
    with pytest.raises(SystemExit) as end:
        main()
    # the sample dive was drawn without windows, and check says so
    expected = (3,) if AIR in words else FINISHED
    assert end.value.code in expected, shlex.join(words)


@pytest.fixture(scope="module")
def shell(tmp_path_factory: pytest.TempPathFactory) -> Shell:
    return Shell(tmp_path_factory.mktemp("shell"))


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of the chessboard that the examples calibrate with."""
    folder = tmp_path_factory.mktemp("board")
    photograph_board(folder, "chessboard:9x6:30mm")
    return folder


@pytest.fixture
def checkout(shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A short checkout, the working folder."""
    shutil.copytree(shell.fresh, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_block(language: str, content: str, monkeypatch: pytest.MonkeyPatch, shell: Shell) -> None:
    if language == "python":
        exec(compile(content, "documentation", "exec"), {})
        return
    for line in filter(None, content.splitlines()):
        shell.run(line, monkeypatch)


@pytest.mark.slow
@pytest.mark.usefixtures("demo_at_hand")
@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if runnable(page)],
    ids=lambda page: page.relative_to(DOCS).as_posix(),
)
def test_commands_of_a_page_run(
    page: Path, checkout: Path, board: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "board/left" in page.read_text(encoding="utf-8"):
        shutil.copytree(board, checkout / DIVE / "board")
    if AIR in page.read_text(encoding="utf-8"):  # a rig that was calibrated before the dive
        rig = (checkout / DIVE / "cam.yaml").read_text(encoding="utf-8")
        (checkout / DIVE / AIR).write_text(
            rig.replace("medium: water", "medium: air"), encoding="utf-8"
        )
    for language, content in runnable(page):
        if content.startswith("cd "):
            monkeypatch.chdir(checkout)
        run_block(language, content, monkeypatch, shell)


@pytest.mark.slow
def test_commands_of_the_readme_run(
    checkout: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(checkout / DIVE)
    for language, content in runnable(ROOT / "README.md"):
        if ".venv" not in content:  # those two are run by tests/docs/test_readme.py and .ci/run
            run_block(language, content, monkeypatch, shell)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_every_page_opens_with_an_example_and_a_picture(page: Path) -> None:
    opening = page.read_text(encoding="utf-8").split("\n## ")[0]
    assert re.search(r"^```(sh|bash|python)$", opening, flags=re.MULTILINE)
    assert re.search(r"!\[.+?\]\((\.\./)?images/", opening)


def test_pictures_exist_and_are_small() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in (*PAGES, ROOT / "README.md"))
    named = {
        Path(name).name for name in re.findall(r"!\[.*?\]\((?:docs/|\.\./)?images/(.+?)\)", text)
    }
    files = {path.name: path.stat().st_size for path in (DOCS / "images").iterdir()}
    assert named == set(files)
    assert not [name for name, size in files.items() if size > MOST_BYTES]


def test_links_of_the_top_level_texts_lead_somewhere() -> None:
    for page in ROOT.glob("*.md"):
        for link in re.findall(r"\]\(((?!https?:)[^)#]+)\)", page.read_text(encoding="utf-8")):
            assert (ROOT / link).exists(), f"{page.name}: {link}"


def test_files_of_the_code_that_texts_name_are_there() -> None:
    files = [
        "/" + path.relative_to(ROOT).as_posix()
        for folder in ("stereo_seecolor", "calibration", "benchmarks", "tests", "docs", "examples")
        for path in (ROOT / folder).rglob("*.py")
    ]
    for page in (*PAGES, *ROOT.glob("*.md")):
        for name in re.findall(r"`([a-z_0-9/]+\.py)`", page.read_text(encoding="utf-8")):
            assert any(file.endswith("/" + name) for file in files), f"{page.name}: {name}"


def test_settings_that_texts_name_are_there() -> None:
    keys = known_keys()
    sections = "|".join({key.partition(".")[0] for key in keys if "." in key})
    for page in TEXTS:
        old = RENAMED if page.name in ("configuration.md", "upgrading.md") else ()
        text = page.read_text(encoding="utf-8")
        for name in re.findall(rf"(?:`|--set )((?:{sections})\.[a-z_0-9.]+)", text):
            known = any(key == name or key.startswith(f"{name.rstrip('.')}.") for key in keys)
            assert known or name in old, f"{page.name}: {name}"


def test_upgrading_names_the_new_form_of_every_setting_that_is_gone() -> None:
    """Every setting but those of color, some of which were gone before 0.2.0 already."""
    page = (DOCS / "upgrading.md").read_text(encoding="utf-8").split("\n## Installation")[0]
    old = "".join(re.findall(r"^\| (`.*?) \|", page, flags=re.MULTILINE))
    gone = [name for name in RENAMED if not name.startswith("color.")]
    assert not [name for name in gone if f"`{name}" not in old]
    for name in re.findall(r"`([a-z]+\.[a-z_.]+)", old):
        assert any(name == known or name.startswith(f"{known}.") for known in RENAMED) or (
            name in known_keys()
        ), f"{name} was never refused"


def test_settings_options_and_commands_that_the_page_names_are_there() -> None:
    """What a text of the page advises can be typed."""
    commands = (DOCS / "commands.md").read_text(encoding="utf-8")
    sections = {key.partition(".")[0] for key in known_keys() if "." in key}
    sections |= {name.partition(".")[0] for name in RENAMED} | {"measuring"}
    for key, text in texts().items():
        plain = re.sub(r"{\w+}", "", text)
        for name in re.findall(rf"\b(?:{'|'.join(sections)})\.[a-z_0-9.]*[a-z_0-9]", plain):
            assert name in known_keys() or (ROOT / "docs" / name).exists(), f"{key}: {name}"
        for option in re.findall(r"--[a-z][a-z-]+", plain):
            assert f"`{option}" in commands, f"{key}: {option}"
        for command in re.findall(r"stereo-seecolor ([a-z][a-z-]+)(?= OUT| --)", plain):
            assert f"## `{command}`" in commands, f"{key}: {command}"


def test_options_that_texts_name_are_there() -> None:
    """Of the commands, and in the pages of experiments of the scripts in benchmarks/."""
    commands = (DOCS / "commands.md").read_text(encoding="utf-8")
    scripts = "".join(path.read_text() for path in (ROOT / "benchmarks").glob("*.py"))
    others = {"--write"}  # of tests/test_golden.py
    for page in TEXTS:
        for name in set(re.findall(r"`(--[a-z][a-z-]+)", page.read_text(encoding="utf-8"))):
            known = f"`{name}" in commands or f'"{name}"' in scripts or name in others
            assert known, f"{page.name}: {name}"


def test_every_page_is_in_the_sites_index() -> None:
    trees = re.findall(
        r"```{toctree}(.*?)```", (DOCS / "index.md").read_text(encoding="utf-8"), flags=re.DOTALL
    )
    listed = re.findall(r"^[\w/-]+$", "".join(trees), flags=re.MULTILINE)
    pages = (page.relative_to(DOCS).with_suffix("").as_posix() for page in PAGES)
    assert sorted(listed) == sorted(page for page in pages if page != "index")


@pytest.mark.slow
def test_reference_pages_are_those_of_this_program() -> None:
    command = [sys.executable, str(DOCS / "reference.py"), "--check"]
    checked = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert checked.returncode == 0, checked.stderr


def test_every_command_has_an_example() -> None:
    for section in (DOCS / "commands.md").read_text(encoding="utf-8").split("\n## `")[1:]:
        assert "```sh\n" in section, (
            f"{section.splitlines()[0]}: add an example to docs/command_examples.py"
        )

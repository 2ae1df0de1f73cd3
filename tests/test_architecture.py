"""The arrows between modules go one way, also through imports inside functions."""

import ast
import graphlib
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("calibration", "stereo_seecolor")


@cache
def parsed(text: str) -> ast.Module:
    return ast.parse(text)


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    name_of(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))
}


def imported(path: Path) -> set[str]:
    """Every module of ours that a file imports, at the top or inside a function; not what only type
    checkers import.
    """
    names: set[str] = set()
    waiting: list[ast.AST] = [parsed(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert not node.level, f"{path}: relative imports are not used here"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif not isinstance(node, ast.expr):  # expressions hold no imports
            waiting += ast.iter_child_nodes(node)
    return {name if name in MODULES else name.rpartition(".")[0] for name in names} & set(MODULES)


@cache
def every_import() -> dict[str, set[str]]:
    """What each module imports of ours."""
    return {name: imported(path) for name, path in MODULES.items()}


def circle(graph: dict[str, set[str]]) -> list[str]:
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.slow
def test_no_import_circle():
    found = circle(every_import())
    assert not found, " imports ".join(reversed(found))


def test_a_circle_through_a_function_is_found(tmp_path, monkeypatch):
    (tmp_path / "a.py").write_text("def f():\n    from b import g\n")
    (tmp_path / "b.py").write_text("import a\n")
    monkeypatch.setitem(globals(), "MODULES", {"a": tmp_path / "a.py", "b": tmp_path / "b.py"})
    assert set(circle({name: imported(tmp_path / f"{name}.py") for name in "ab"})) == {"a", "b"}


@pytest.mark.slow
def test_the_contracts_of_imports_are_kept() -> None:
    command = [
        sys.executable,
        "-c",
        "import sys, importlinter.cli; sys.exit(importlinter.cli.lint_imports())",
    ]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout


SLOW_TO_IMPORT = {"scipy", "torch", "open3d", "skimage", "rasterio", "gtsam"}
"""Libraries that take 0.2 s and more, which ``run`` on an ordinary dive does not need; functions
that do import them themselves.
"""


def imported_at_once(path: Path) -> set[str]:
    """Modules that a file imports when it is imported itself, as it names them."""
    found: set[str] = set()
    for node in parsed(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


@pytest.mark.slow
def test_run_starts_without_libraries_that_take_long_to_import() -> None:
    waiting, seen, slow = (
        [
            f"stereo_seecolor.{name}"
            for name in ("cli.app", "commands.run", "commands.view", "report.page")
        ],
        set(),
        set(),
    )
    while waiting:
        module = waiting.pop()
        if module in seen:
            continue
        seen.add(module)
        names = imported_at_once(MODULES[module])
        slow |= {
            f"{module} imports {name}" for name in names if name.split(".")[0] in SLOW_TO_IMPORT
        }
        waiting += [name for name in names if name in MODULES]
    assert len(seen) > 100
    assert not slow


@pytest.mark.xdist_group("together")
def test_tests_of_a_group_run_in_one_process(request: pytest.FixtureRequest) -> None:
    """xdist 3.8 tells groups by the ends of names, which pytest 9.2 keeps it from writing: fixtures
    that many tests share are then made in each process, and nothing says so.
    """
    in_groups = getattr(request.config.option, "loadgroup", False)
    assert request.node.nodeid.endswith("@together") == in_groups, "pytest as in constraints.txt"


def test_no_two_classes_share_a_name() -> None:
    names = Counter(
        node.name
        for path in MODULES.values()
        for node in parsed(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, number in names.items() if number > 1] == []


def test_private_names_are_used_in_their_file_alone() -> None:
    wrong = []
    for path in MODULES.values():
        text = path.read_text(encoding="utf-8")
        for node in parsed(text).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                is_private = node.name.startswith("_") and not node.name.startswith("__")
                if is_private and len(re.findall(rf"\b{node.name}\b", text)) == 1:
                    wrong.append(f"{path}: nobody calls {node.name}")
            elif isinstance(node, ast.ImportFrom):
                private = [alias.name for alias in node.names if re.match("_[^_]", alias.name)]
                wrong += [f"{path} imports {name}" for name in private if node.module in MODULES]
    assert not wrong

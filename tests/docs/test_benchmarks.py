"""Every benchmark tells what it measures and what it takes."""

import ast
import importlib
import inspect
import io
import runpy
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "benchmarks"
SCRIPTS = [*sorted(BENCHMARKS.glob("*.py")), ROOT / "examples/sample_dive.py"]
GONE = """
from stereo_seecolor.config import RunConfig
from stereo_seecolor.extras.synthetic import survey

def f(config: RunConfig) -> None:
    RunConfig(gone=1)
    survey.SurveySpec(gone=1)
    config.model_copy(gone=1)
    config.model_copy(update={})
"""


@pytest.fixture(autouse=True)
def beside_the_scripts(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Scripts import each other."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(BENCHMARKS)
    yield
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(BENCHMARKS)):
            del sys.modules[name]


@pytest.mark.slow
def test_every_benchmark_answers_help(monkeypatch: pytest.MonkeyPatch) -> None:
    scripts = [path for path in SCRIPTS[:-1] if "__main__" in path.read_text(encoding="utf-8")]
    assert len(scripts) > 20
    for path in scripts:
        monkeypatch.setattr(sys, "argv", [str(path), "--help"])
        with redirect_stdout(io.StringIO()) as said, suppress(SystemExit):
            runpy.run_path(str(path), run_name="__main__")
        first = said.getvalue().partition("\n")[0]
        assert first.startswith("usage: ") and path.name in first, (path, first)


class Script:
    """The text of a script, and what its names stand for. imported: what it imports; kinds: the
    classes that its variables are declared as, or made by.
    """

    def __init__(self, text: str) -> None:
        nodes = list(ast.walk(ast.parse(text)))
        self._calls = [node for node in nodes if isinstance(node, ast.Call)]
        self.imported: dict[str, Any] = {}
        self.kinds: dict[str, set[Any]] = {}
        for node in nodes:
            if isinstance(node, ast.ImportFrom):
                self._import(node)
        for node in nodes:
            match node:
                case ast.arg(arg=name, annotation=kind):
                    self.kinds.setdefault(name, set()).add(self._meant(kind))
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    made = self._meant(value.func) if isinstance(value, ast.Call) else None
                    kind = made if inspect.isclass(made) else None
                    self.kinds.setdefault(name, set()).add(kind)

    def _import(self, node: ast.ImportFrom) -> None:
        module = importlib.import_module(node.module or "")
        for name in node.names:
            if not hasattr(module, name.name):
                importlib.import_module(f"{node.module}.{name.name}")
            self.imported[name.asname or name.name] = getattr(module, name.name)

    def _meant(self, node: ast.AST | None) -> Any:
        if isinstance(node, ast.Attribute):
            return getattr(self._meant(node.value), node.attr, None)
        return self.imported.get(node.id) if isinstance(node, ast.Name) else None

    def calls(self) -> Iterator[tuple[ast.Call, Any]]:
        """Each call of what is known, with what it calls."""
        for call in self._calls:
            called = self._meant(call.func)
            match call.func:
                case ast.Name(id=name) if name in self.kinds:
                    called = None
                case ast.Attribute(value=ast.Name(id=name), attr=method) if name in self.kinds:
                    kinds = self.kinds[name]
                    function = getattr(*kinds, method, None) if len(kinds) == 1 else None
                    called = function.__get__(0) if inspect.isfunction(function) else None
            if callable(called):
                yield call, called


def misfit(call: ast.Call, called: Any) -> str:
    """What is wrong with the arguments of a call; "" where they fit."""
    given = [one for one in call.args if not isinstance(one, ast.Starred)]
    names = {one.arg: None for one in call.keywords if one.arg}
    whole = len(given) == len(call.args) and len(names) == len(call.keywords)
    try:
        signature = inspect.signature(called)
        (signature.bind if whole else signature.bind_partial)(*given, **names)
    except TypeError as error:
        return f"{call.lineno}: {ast.unparse(call.func)}: {error}"
    except ValueError:  # of a builtin
        pass
    return ""


@pytest.mark.slow
def test_benchmarks_give_functions_the_arguments_that_they_take() -> None:
    """They run for minutes, so their calls are looked at for parameters that are not there."""
    gone = [misfit(*call) for call in Script(GONE).calls()]
    assert [bool(wrong) for wrong in gone] == [True, True, True, False], gone
    for path in SCRIPTS:
        calls = Script(path.read_text(encoding="utf-8")).calls()
        wrong = [what for call in calls if (what := misfit(*call))]
        assert not wrong, (path.name, wrong)


def test_deliberate_breaks_are_of_the_code_as_it_is() -> None:
    names = runpy.run_path(str(BENCHMARKS / "mutations.py"))
    tests = BENCHMARKS.parent / "tests"
    assert len({each.file for each in names["BREAKS"]}) >= 20
    for each in names["BREAKS"]:
        assert not names["missing"](each)
        assert each.new != each.old
        assert all((tests / path).exists() for path in each.tests.split()), each.tests

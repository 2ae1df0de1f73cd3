"""What the top of the package exports can be imported and keeps its parameters; importing the
package alone loads nothing heavy.
"""

import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

import calibration
import stereo_seecolor


@pytest.mark.parametrize("name", stereo_seecolor.__all__)
def test_every_public_name_can_be_imported_and_says_what_it_is(name: str) -> None:
    public = getattr(stereo_seecolor, name)
    assert name == "__version__" or public.__doc__


def test_a_name_that_does_not_exist_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Pipelin'"):
        stereo_seecolor.Pipelin  # noqa: B018


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = (
        "import sys, stereo_seecolor; print([m for m in ('cv2', 'torch', 'numba', 'scipy', "
        "'open3d') if m in sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )


SIGNATURES = Path(__file__).resolve().parents[2] / "tests" / "golden" / "public_api.txt"


def parameters(function: Callable[..., Any]) -> str:
    """The parameters of a function in order, ``*`` before those by keyword alone, ``=`` behind
    those with a default.
    """
    found = list(inspect.signature(function).parameters.values())
    by_name = next((i for i, p in enumerate(found) if p.kind is p.KEYWORD_ONLY), len(found))
    words = [p.name + ("=" if p.default is not p.empty else "") for p in found]
    return " ".join([*words[:by_name], *["*"] * (by_name < len(found)), *words[by_name:]])


def public_signatures() -> dict[str, str]:
    """The public names of both packages, and the public methods and properties of their classes,
    with their parameters.
    """
    found: dict[str, str] = {}
    for package in (stereo_seecolor, calibration):
        for name in package.__all__:
            thing, where = getattr(package, name), f"{package.__name__}.{name}"
            plain = not callable(thing) or (
                isinstance(thing, type) and issubclass(thing, Exception | BaseModel)
            )
            found[where] = "" if plain else parameters(thing)
            for member, value in (
                vars(thing).items() if isinstance(thing, type) and not plain else ()
            ):
                if not member.startswith("_"):
                    function = getattr(value, "__func__", value)
                    found[f"{where}.{member}"] = (
                        parameters(function) if inspect.isfunction(function) else ""
                    )
    return dict(sorted(found.items()))


def test_what_programs_call_is_still_there() -> None:
    """Programs go on to work: names stay, and their parameters in order; what is new comes behind
    them and has a default.

    ``PYTHONPATH=. python tests/docs/test_public_api.py`` writes the file, for a release.
    """
    now = public_signatures()
    for line in SIGNATURES.read_text(encoding="utf-8").splitlines():
        name, _, given = line.partition(": ")
        words, current = given.split(), now[name].split()
        assert current[: len(words)] == words, name
        assert all(word.endswith("=") or word == "*" for word in current[len(words) :]), name


def documented(text: str, section: str) -> set[str]:
    """The names that a section of a docstring in Google style explains."""
    body = re.search(rf"^{section}:\n((?: .*\n|\n(?= ))*)", f"{text}\n", re.MULTILINE)
    return set(re.findall(r"^ {4}(\w+): ", body[1], re.MULTILINE)) if body else set()


def undocumented(thing: Any, where: str) -> list[str]:
    """The parameters of a function or class, and of its public methods, that its docstring does not
    explain.
    """
    section = "Attributes" if is_dataclass(thing) else "Args"
    found = documented(inspect.getdoc(thing) or "", section)
    missing = [
        f"{where}: {name}" for name in inspect.signature(thing).parameters if name not in found
    ]
    for name, member in vars(thing).items() if isinstance(thing, type) else ():
        function = getattr(member, "__func__", member)
        field = name in inspect.signature(thing).parameters
        if inspect.isfunction(function) and not field and not name.startswith("_"):
            given = set(inspect.signature(function).parameters) - {"self", "cls"}
            lacking = given - documented(inspect.getdoc(function) or "", "Args")
            missing += [f"{where}.{name}: {parameter}" for parameter in sorted(lacking)]
    return missing


@pytest.mark.parametrize("package", [stereo_seecolor, calibration])
def test_every_public_parameter_is_explained(package: Any) -> None:
    names = [name for name in package.__all__ if callable(getattr(package, name))]
    things = {name: getattr(package, name) for name in names}
    plain = {
        name: thing
        for name, thing in things.items()
        if not (isinstance(thing, type) and issubclass(thing, Exception | BaseModel))
    }
    assert not [line for name, thing in plain.items() for line in undocumented(thing, name)]


if __name__ == "__main__":
    SIGNATURES.write_text(
        "".join(f"{name}: {given}\n" for name, given in public_signatures().items()),
        encoding="utf-8",
    )

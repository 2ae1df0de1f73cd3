"""Every regular expression of the product on 10 kB of text made to trip it: none takes a time that
grows with more than about the square of the text.
"""

import ast
import importlib
import re
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from re import _constants as sre  # type: ignore[attr-defined]  # its parser has no public name
from re import _parser as sre_parser  # type: ignore[attr-defined]
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
LENGTH = 10_000
SECONDS = 0.25
FLAGS_AT = {
    "compile": 1,
    "match": 2,
    "search": 2,
    "fullmatch": 2,
    "findall": 2,
    "finditer": 2,
    "split": 3,
    "sub": 4,
}
"""Functions of re, and at which place they take flags."""
ENDS = ("", "!", "\n x")
FILLS = (
    *("0", "1021 ", "1.5,", " ", "\n", " \n", "a", ".", "a:", "a = ", "(", "[", "{", '"', '\\"'),
    *("<a>", "/", "/*", "#\n", "a b ", ",", "° "),
)
REPEATS = (sre.MAX_REPEAT, sre.MIN_REPEAT, sre.POSSESSIVE_REPEAT)
MANY = 9  # a repetition that runs more often may run without end

# Patterns that a function makes of its arguments: module and expression -> values in its module.
LOCAL_PATTERNS: dict[tuple[str, str], Callable[[Any], Iterable[str]]] = {
    (
        "calibration.formats.reading.aliases",
        r"'|'.join(spellings.split()).replace('*', '\\w*')",
    ): lambda m: [words.pattern for words in m.ALIASES.values()],
    ("calibration.formats.reading.unread_formats", "pattern"): lambda m: m.FOREIGN.values(),
    ("stereo_seecolor.files.csv_tables", "DECIMAL_COMMA.format(separator)"): lambda m: [
        m.DECIMAL_COMMA.format(";")
    ],
    ("stereo_seecolor.inputs.name_keys", "f'(?<!{_LETTER})({words})(?!{_LETTER})'"): lambda m: [
        words.pattern for words in m._SIDE_WORDS.values()
    ],
    ("stereo_seecolor.inputs.trajectories.foreign", "begin"): lambda m: [b for b, _ in m._BINARY],
    ("stereo_seecolor.inputs.trajectories.foreign", "pattern"): lambda m: [p for p, _ in m._TEXT],
    ("stereo_seecolor.inputs.trajectories.receivers", "PLACE.format(name)"): lambda m: [
        m.PLACE.format("lat")
    ],
    ("stereo_seecolor.mapping.marker_tables", "pattern"): lambda m: [
        *m.BAR.values(),
        *m.PLACE.values(),
    ],
}


def patterns() -> dict[str, tuple[re.Pattern[Any], set[str]]]:
    """Place in the source -> pattern, and the methods that apply it; each is made as its module
    makes it.
    """
    found: dict[str, tuple[re.Pattern[Any], set[str]]] = {}
    for package in ("calibration", "stereo_seecolor"):
        for path in sorted((ROOT / package).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            if re.search(r"^import re$", source, re.MULTILINE):
                name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
                found |= _of_module(name.removesuffix(".__init__"), source)
    return found


def _of_module(name: str, source: str) -> dict[str, tuple[re.Pattern[Any], set[str]]]:
    module = importlib.import_module(name)
    found: dict[str, tuple[re.Pattern[Any], set[str]]] = {}
    for node in ast.walk(ast.parse(source)):
        if not (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and isinstance(node.func.value, ast.Name)
            and node.func.value.id == "re"
            and node.func.attr in FLAGS_AT
        ):
            continue
        method, text = node.func.attr, ast.unparse(node.args[0])
        at = FLAGS_AT[method]
        flags = [*node.args[at : at + 1], *(k.value for k in node.keywords if k.arg == "flags")]
        for made in _made(module, text):
            pattern = re.compile(made, eval(ast.unparse(flags[0]), {"re": re}) if flags else 0)
            methods = _uses(source, node) if method == "compile" else {method}
            found[f"{name}:{node.lineno}:{len(found)}"] = (pattern, methods)
    return found


def _made(module: ModuleType, text: str) -> list[str]:
    """The patterns that an expression of a module makes."""
    if local := LOCAL_PATTERNS.get((module.__name__, text)):
        return list(local(module))
    try:
        return [eval(text, dict(vars(module)))]
    except NameError as error:
        raise AssertionError(
            f"{module.__name__}: re is given {text}, made of local values: add it to LOCAL_PATTERNS"
        ) from error


def _uses(source: str, node: ast.Call) -> set[str]:
    """How a compiled pattern of a module is applied; by search where its name is not plain."""
    own = re.match(r"\w+", source.splitlines()[node.lineno - 1])
    uses = set(re.findall(rf"\b{own[0]}\.(\w+)", source)) if own else set()
    return uses & FLAGS_AT.keys() or {"search"}


def attacks(pattern: re.Pattern[Any]) -> Iterator[str]:
    """Texts that a pattern nearly matches: for each of its repetitions, what leads to it, then the
    repeated part over and over, then an end that does not fit.
    """
    tree = list(sre_parser.parse(pattern.pattern, pattern.flags))
    own = {each for times in (1, 2, 3) for each in _repeated(tree, times)}
    begins = {("", lead) for lead, _ in own if lead}  # of a part whose end never comes
    fills = {("", fill) for fill in FILLS if own}
    for lead, body in sorted(own | begins | fills):
        filled = lead + body * (LENGTH // max(len(body), 1))
        yield from (filled + end for end in ENDS)


def _repeated(tree: list[Any], times: int, lead: str = "") -> Iterator[tuple[str, str]]:
    """Of each repetition, what leads to it, and its body, whose own repetitions run some times."""
    for op, argument in tree:
        if op in REPEATS:
            _, most, inner = argument
            if most > MANY:
                yield lead, _sample(list(inner), times)
            yield from _repeated(list(inner), times, lead)
        elif op is sre.SUBPATTERN:
            yield from _repeated(list(argument[3]), times, lead)
        elif op is sre.ATOMIC_GROUP:
            yield from _repeated(list(argument), times, lead)
        elif op is sre.BRANCH:
            for way in argument[1]:
                yield from _repeated(list(way), times, lead)
        lead += _sample([(op, argument)], times)


def _sample(tree: list[Any], times: int) -> str:
    """A text that fits."""
    made = ""
    for op, argument in tree:
        if op is sre.LITERAL:
            made += chr(argument)
        elif op in (sre.NOT_LITERAL, sre.ANY):
            made += "a"
        elif op is sre.IN:
            made += _of_class(argument)
        elif op in REPEATS:
            least, most, inner = argument
            made += _sample(list(inner), times) * min(max(least, times), most, least + times)
        elif op is sre.SUBPATTERN:
            made += _sample(list(argument[3]), times)
        elif op is sre.ATOMIC_GROUP:
            made += _sample(list(argument), times)
        elif op is sre.BRANCH:
            made += _sample(list(argument[1][0]), times)
    return made


def _of_class(members: list[Any]) -> str:
    classes = {sre.CATEGORY_DIGIT: "1", sre.CATEGORY_WORD: "a", sre.CATEGORY_SPACE: " "}
    if members[0][0] is sre.NEGATE:
        taken = {_of_class([member]) for member in members[1:]}
        return next(c for c in "a 1.-_:x" if c not in taken)
    for op, argument in members:
        if op is sre.LITERAL:
            return chr(argument)
        if op is sre.RANGE:
            return chr(argument[0])
        if op is sre.CATEGORY and argument in classes:
            return classes[argument]
    return "a"  # of a class that leaves some out


class TooSlowError(Exception):
    """A pattern took its time."""


def apply(pattern: re.Pattern[Any], method: str, text: str) -> float:
    """The seconds of a processor that a pattern takes for a text."""
    given: Any = text if isinstance(pattern.pattern, str) else text.encode(errors="replace")
    start_s = time.process_time()
    if method == "sub":
        pattern.sub(given[:0], given)
    elif method in ("findall", "finditer", "split"):
        list(getattr(pattern, method)(given))
    else:
        getattr(pattern, method)(given)
    return time.process_time() - start_s


@pytest.mark.posix
@pytest.mark.slow
def test_no_pattern_takes_long() -> None:
    def too_slow(*_: object) -> None:
        raise TooSlowError

    signal.signal(signal.SIGVTALRM, too_slow)
    slow = {}
    for place, (pattern, methods) in patterns().items():
        for text in attacks(pattern):
            for method in methods:
                signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
                try:
                    apply(pattern, method, text)
                except TooSlowError:
                    slow[place] = (pattern.pattern, method, text[:40], text[-40:])
                finally:
                    signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            if place in slow:
                break
    assert not slow, "\n".join(f"{place}: {what}" for place, what in slow.items())

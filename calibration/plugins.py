"""Objects that packages add by entry points, checked for their type when they are loaded.

Nothing of a package is imported before one of its objects is used.
"""

from collections.abc import Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

Kind = type[Any] | tuple[type[Any], ...]


@cache
def added(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group, by name, sorted."""
    found = _of_all_packages().select(group=group)
    return {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}


@cache
def _of_all_packages() -> Any:
    """Read once: every installed package has a file of them."""
    return entry_points()


def load(
    group: str, name: str, error: type[Exception], kind: Kind = object, needs: Sequence[str] = ()
) -> Any:
    """The object that an entry point names.

    Args:
        group: The whole name of the group, as in pyproject.toml.
        name: of the entry point.
        error: what is raised if no installed package adds it, the package cannot be imported, or
            adds something else; its message names the package and what is missing.
        kind: the object's class, or one of several.
        needs: names of functions that it has; ``__call__`` where it is one itself.
    """
    entry = added(group).get(name)
    if entry is None:
        raise error(
            f"{name}: no installed package adds it to {group} (known: "
            f"{', '.join(added(group)) or 'none'})"
        )
    try:
        found = entry.load()
    except (ImportError, AttributeError) as cause:
        raise error(
            f"{name}: the package {_package(entry)}, which adds it to {group}, cannot be loaded: "
            f"{cause}"
        ) from cause
    return checked(found, group, name, error, kind, needs)


def checked(
    found: Any,
    group: str,
    name: str,
    error: type[Exception],
    kind: Kind = object,
    needs: Sequence[str] = (),
) -> Any:
    """What a package handed over, if it is what the group takes; see ``load``."""
    missing = [each for each in needs if not callable(getattr(found, each, None))]
    if isinstance(found, kind) and not missing:
        return found
    if not isinstance(found, kind):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        wanted = f"not of the class {' or '.join(each.__name__ for each in kinds)}"
    elif missing == ["__call__"]:
        wanted = "which cannot be called"
    else:
        wanted = f"which has no function {missing[0]!r}"
    raise error(
        f"{name}: the package {_package(added(group)[name])} adds an object of type "
        f"{type(found).__name__} to {group}, {wanted}: see docs/extending.md"
    )


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.value

"""Parts that packages add to the program by entry points: the extras of this package, and those of
third parties.

An entry point of the group ``stereo_seecolor.GROUP`` names an object of the kind that
docs/extending.md describes for that group. Nothing is imported before a part is used.
"""

from collections.abc import Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from stereo_seecolor.errors import PluginError


@cache
def added(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group, by name, sorted.

    Args:
        group: commands, exports, recordings, inputs, containers, trajectory_formats, engines,
            matching_engines, color_methods, executors, or page_parts.
    """
    return {
        entry.name: entry
        for entry in sorted(
            entry_points(group=f"stereo_seecolor.{group}"), key=lambda entry: entry.name
        )
    }


def load(group: str, name: str, kind: type[Any] = object, needs: Sequence[str] = ()) -> Any:
    """The object that an entry point names.

    Args:
        group: as in ``added``.
        name: of the entry point.
        kind: its class.
        needs: names of functions that it has; ``__call__`` where it is one itself.

    Raises:
        PluginError: if no installed package adds it, the package cannot be imported, or adds
            something else.
    """
    entry = added(group).get(name)
    if entry is None:
        raise PluginError(
            f"{name}: no installed package adds it to {group} (known: "
            f"{', '.join(added(group)) or 'none'})"
        )
    try:
        found = entry.load()
    except (ImportError, AttributeError) as error:
        raise PluginError(
            f"{name}: the package {_package(entry)}, which adds it to {group}, cannot be loaded: "
            f"{error}"
        ) from error
    return checked(found, group, name, kind, needs)


def checked(
    found: Any, group: str, name: str, kind: type[Any] = object, needs: Sequence[str] = ()
) -> Any:
    """What a package handed over, if it is what the group takes; see ``load``. Raises
    PluginError.
    """
    missing = [each for each in needs if not callable(getattr(found, each, None))]
    if isinstance(found, kind) and not missing:
        return found
    if not isinstance(found, kind):
        wanted = f"not of the class {kind.__name__}"
    elif missing == ["__call__"]:
        wanted = "which cannot be called"
    else:
        wanted = f"which has no function {missing[0]!r}"
    raise PluginError(
        f"{name}: the package {_package(added(group)[name])} adds an object of type "
        f"{type(found).__name__} to {group}, {wanted}: see docs/extending.md"
    )


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.value

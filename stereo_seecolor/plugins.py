"""Parts that packages add to the program by entry points: the extras of this package, and those of
third parties.

An entry point of the group ``stereo_seecolor.GROUP`` names an object of the kind that
docs/extending.md describes for that group. Nothing is imported before a part is used.
"""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from stereo_seecolor.errors import PluginError


@cache
def added(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group, by name, sorted.

    Args:
        group: commands, exports, recordings, inputs, containers, trajectory_formats, engines,
        matching_engines, executors,
            or page_parts.
    """
    return {
        entry.name: entry
        for entry in sorted(
            entry_points(group=f"stereo_seecolor.{group}"), key=lambda entry: entry.name
        )
    }


def load(group: str, name: str) -> Any:
    """The object that an entry point names.

    Raises:
        PluginError: if no installed package adds it, or the package cannot be imported.
    """
    entry = added(group).get(name)
    if entry is None:
        raise PluginError(
            f"{name}: no installed package adds it to {group} (known: "
            f"{', '.join(added(group)) or 'none'})"
        )
    try:
        return entry.load()
    except (ImportError, AttributeError) as error:
        package = entry.dist.name if entry.dist else entry.value
        raise PluginError(
            f"{name}: the package {package}, which adds it to {group}, cannot be loaded: {error}"
        ) from error

"""Parts that packages add to the program by entry points: extras of this one, and third parties'.

An entry point of the group ``stereo_seecolor.GROUP`` names an object of the kind that
docs/extending.md describes for that group.
"""

from collections.abc import Sequence
from importlib.metadata import EntryPoint
from typing import Any

from calibration import plugins
from stereo_seecolor.errors import PluginError


def added(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group, by name, sorted.

    Args:
        group: commands, exports, recordings, inputs, containers, trajectory_formats, engines,
            matching_engines, color_methods, executors, or page_parts.
    """
    return plugins.added(f"stereo_seecolor.{group}")


def load(group: str, name: str, kind: plugins.Kind = object, needs: Sequence[str] = ()) -> Any:
    """The object that an entry point names.

    Args:
        group: as in ``added``.
        name: of the entry point.
        kind: its class, or one of several.
        needs: names of functions that it has; ``__call__`` where it is one itself.

    Raises:
        PluginError: if no installed package adds it, the package cannot be imported, or adds
            something else.
    """
    return plugins.load(f"stereo_seecolor.{group}", name, PluginError, kind, needs)


def checked(
    found: Any, group: str, name: str, kind: plugins.Kind = object, needs: Sequence[str] = ()
) -> Any:
    """What a package handed over, if the group takes it; see ``load``. Raises PluginError."""
    return plugins.checked(found, f"stereo_seecolor.{group}", name, PluginError, kind, needs)

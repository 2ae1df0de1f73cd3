"""A command of the program, as the core and packages that add commands declare it."""

from collections.abc import Callable
from dataclasses import dataclass

SIDES = "--left left --right right --calib cam.yaml"
"""Both sides and the calibration of a dive, as examples name them."""


@dataclass(frozen=True)
class Command:
    """A command of the program.

    Attributes:
        function: its parameters are the options of the command, annotated as typer reads them.
        panel: heading under which the help lists it.
        examples: what a user types after the program's name, for the help of the command.
    """

    function: Callable[..., None]
    panel: str
    examples: tuple[str, ...]


def command(panel: str, *examples: str) -> Callable[[Callable[..., None]], Command]:
    """Declare a function as a command: ``@command("Ecology", "metrics OUT")``."""
    return lambda function: Command(function, panel, examples)

"""Options that many commands have together: a parameter of a command that is a dataclass stands for an option a field."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints

from stereo_seecolor.cli.report import Report


def one_by_one(name: str, command: Callable[..., None]) -> Callable[..., None]:
    """The command as typer takes it, with every option a parameter of its own. name: of the command, for its report."""
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, type[Any]] = {key: kind for key, kind in hints.items() if isinstance(kind, type) and is_dataclass(kind)}
    options: list[Parameter] = []
    for parameter in signature(command).parameters.values():
        inside = signature(groups[parameter.name]).parameters if parameter.name in groups else {parameter.name: parameter}
        options += [one.replace(kind=Parameter.KEYWORD_ONLY) for key, one in inside.items() if key != "command"]

    def run(**given: Any) -> None:
        for key, group in groups.items():
            own = {field.name: given.pop(field.name) for field in fields(group) if field.name in given}
            given[key] = group(name, **own) if issubclass(group, Report) else group(**own)
        command(**given)

    run.__doc__, run.__annotations__ = command.__doc__, {one.name: one.annotation for one in options}
    run.__dict__["__signature__"] = Signature(options)
    return run

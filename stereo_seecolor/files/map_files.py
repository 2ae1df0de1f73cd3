"""Map files that are whole or not there at all."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from stereo_seecolor.errors import OutputError


def _full(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"{path}: cannot be written: {error.strerror or error}: free the place and run again, finished tiles are kept"
    )


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Give a temporary path beside ``path`` to write to, and rename it once that went well.

    Raises OutputError, naming the file, if the disk is full or the place cannot be written.
    """
    temporary = path.with_name(f".writing-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise _full(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)

"""Deflate compression (RFC 1950) of PNG, TIFF and the page's data; any program can inflate it."""

import zlib

try:
    from isal.isal_zlib import compress as fast_compress
    from isal.isal_zlib import decompressobj as fast_inflater
    from isal.isal_zlib import error as fast_error
except ImportError:  # no wheel for this machine: the same content, in more time

    def fast_compress(content: bytes | memoryview, _: int) -> bytes:  # type: ignore[misc]  # noqa: D103
        return deflated_runs(content)

    fast_inflater, fast_error = zlib.decompressobj, zlib.error  # type: ignore[assignment]

FAST_LEVEL = 1
"""Of ISA-L: 12 ms for the 4 MB of a filtered picture of 1.3 megapixels. Level 0 gives 36 % more, 2
and 3 the same.
"""


def deflated(content: bytes | memoryview, repeats: bool = False) -> bytes:
    """A zlib stream, by Intel's ISA-L, which runs on ARM too. Filtered pictures are mostly noise:
    zlib's levels 6 to 9 find 5 to 8 % in them by chance, in 20 times the time.

    repeats: by zlib's level 6, for what does repeat: a mesh's triangles take a fifth less.
    """
    if repeats:
        return zlib.compress(content, 6)
    return bytes(fast_compress(content, FAST_LEVEL))


def deflated_runs(content: bytes | memoryview) -> bytes:
    """A zlib stream that looks only for runs of a byte: differences of a mesh take a tenth less,
    and less time, than where repeats are looked for, which they have by chance.
    """
    runs = zlib.compressobj(6, strategy=zlib.Z_RLE)
    return runs.compress(content) + runs.flush()


def inflated(content: bytes | memoryview, size: int) -> bytes:
    """The ``size`` bytes of a zlib stream. Raises ValueError if it holds fewer or more, which are
    not inflated, or is damaged.
    """
    inflater = fast_inflater()
    try:
        found = bytes(inflater.decompress(content, size + 1))
    except (zlib.error, fast_error) as error:  # type: ignore[misc]  # a class, whatever its stub says
        raise ValueError(str(error)) from error
    if len(found) != size or not inflater.eof:
        raise ValueError(f"does not hold {size} bytes")
    return found

"""The decorator of all functions that numba compiles to machine code.

>>> @compiled
... def total(values: NDArray[np.float32]) -> float: ...  # doctest: +SKIP

numba is imported, and a function compiled, when a compiled function is first called. The machine
code is kept on disk (``compute/kernel_cache.py``).
"""

import functools
import threading
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar, overload

P = ParamSpec("P")
R = TypeVar("R")

STAGE = "compiling for this machine, once"
"""What commands say of their first run."""

_building = threading.Lock()


class Compiled(Generic[P, R]):
    """A function that is compiled at its first call; other compiled functions may call it, too.

    The GIL is released while it runs. Division by zero gives infinity or NaN, as in numpy.
    """

    def __init__(self, function: Callable[P, R], options: dict[str, Any]) -> None:
        self._options = options
        self._dispatcher: Any = None
        self._callee: Any = None
        self.py_func = function
        functools.update_wrapper(self, function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Run the machine code for arguments of these types."""
        result: R = (self._dispatcher or self.dispatcher)(*args, **kwargs)
        return result

    @property
    def dispatcher(self) -> Any:
        """numba's compiled function, for calls from Python."""
        with _building:
            if self._dispatcher is None:
                from stereo_seecolor.compute.kernel_cache import dispatcher

                self._dispatcher = dispatcher(self.py_func, self._options)
        return self._dispatcher

    @property
    def missing(self) -> bool:
        """True if a function's machine code can be kept on disk, and is not for these sources."""
        from stereo_seecolor.compute.kernel_cache import is_missing

        return is_missing(self.dispatcher)

    @property
    def _numba_type_(self) -> Any:
        """How numba sees this object where another compiled function names it."""
        from numba import types

        with _building:
            if self._callee is None:
                from stereo_seecolor.compute.kernel_cache import callee

                self._callee = callee(self.py_func, self._options)
        return types.Dispatcher(self._callee)


@overload
def compiled(function: Callable[P, R], /) -> Compiled[P, R]: ...
@overload
def compiled(*, inline: bool = False) -> Callable[[Callable[P, R]], Compiled[P, R]]: ...
def compiled(function: Callable[..., Any] | None = None, /, *, inline: bool = False) -> Any:
    """Compile a function with numba: ``@compiled``, or ``@compiled(inline=True)``.

    inline: put the code into the callers, even where LLVM finds it too long.
    """
    options = {"forceinline": inline}
    return Compiled(function, options) if function else lambda one: Compiled(one, options)

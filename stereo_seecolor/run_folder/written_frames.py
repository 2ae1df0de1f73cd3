"""The frames that this run has written, stage by stage."""

from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.run_folder.layout import Stage

STAGES: tuple[Stage, ...] = ("range", "corrected", "rectified", "page")


class WrittenFrames:
    """Frames by name, with a bit for each stage; frames may be added by many threads."""

    def __init__(self) -> None:
        self._names, self._bits = Names(), bytearray()
        self._lock = Lock()

    def add(self, stage: Stage, name: str) -> None:
        """Note that a frame's stage was written."""
        with self._lock:
            number = self._names.add(name)
            if number == len(self._bits):
                self._bits.append(0)
            self._bits[number] |= 1 << STAGES.index(stage)

    def stages(self, name: str) -> tuple[Stage, ...]:
        """The stages of a frame that were written."""
        with self._lock:
            number = self._names.number(name)
            bits = 0 if number is None else self._bits[number]
        return tuple(stage for bit, stage in enumerate(STAGES) if bits >> bit & 1)

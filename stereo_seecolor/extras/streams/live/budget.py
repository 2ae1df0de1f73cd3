"""Keeps the time for a pair within a budget: it is matched at full, half or quarter size."""

from collections import deque
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class BudgetConstants:
    """When the size changes."""

    pairs: int = 5  # the median of this many decides: one slow pair does not
    smallest: int = 4  # at less than a quarter of the size little is left of a reef's relief
    # times that a pair takes longer at twice the size: matching takes 4 to 8, reading and color
    # stay
    growth: float = 3.0
    # pairs before the larger size is tried again; doubled each time that it turns out too slow
    patience: int = 20
    most_patience: int = 2000
    # fraction of the budget in which a fit may take steps: a pair that is matched in time stays
    # within it
    fitting: float = 0.9


CONSTANTS = BudgetConstants()


class Budget:
    """Chooses the size at which images are matched: 1/shrink, with shrink 1, 2 or 4.

    budget_s: seconds from reading a pair to its corrected image; None: no limit, shrink is 1.
    """

    def __init__(self, budget_s: float | None) -> None:
        self.shrink = 1
        self._budget_s = budget_s
        self._recent: deque[float] = deque(maxlen=CONSTANTS.pairs)
        self._patience, self._at_this_size, self._too_slow_s = CONSTANTS.patience, 0, 0.0

    @property
    def text(self) -> str:
        """A note on the reduced size and its reason; "" at full size."""
        if self.shrink == 1 or self._budget_s is None:
            return ""
        larger = "full size" if self.shrink == 2 else f"1/{self.shrink // 2}"
        return (
            f"matched at 1/{self.shrink} of the size to keep within {1000 * self._budget_s:.0f} "
            f"ms per pair ({1000 * self._too_slow_s:.0f} ms at {larger})"
        )

    def until_s(self, began_s: float, rest_s: float) -> float | None:
        """When the steps of a fit end for a pair that began then, of which ``rest_s`` seconds
        follow the fit; None for no limit.
        """
        return (
            None
            if self._budget_s is None
            else began_s + CONSTANTS.fitting * self._budget_s - rest_s
        )

    def took(self, seconds: float) -> None:
        """Note the time that a pair took; the size may change."""
        self._recent.append(seconds)
        self._at_this_size += 1
        if self._budget_s is None or len(self._recent) < CONSTANTS.pairs:
            return
        usual_s = median(self._recent)
        if usual_s > self._budget_s and self.shrink < CONSTANTS.smallest:
            self._too_slow_s = usual_s
            self._patience = min(2 * self._patience, CONSTANTS.most_patience)
            self._turn_to(2 * self.shrink)
        elif (
            self.shrink > 1
            and self._at_this_size >= self._patience
            and usual_s * CONSTANTS.growth < self._budget_s
        ):
            self._turn_to(self.shrink // 2)

    def _turn_to(self, shrink: int) -> None:
        self.shrink, self._at_this_size = shrink, 0
        self._recent.clear()

"""Which frames share a water: each has its own, the last few, a segment, or all of a dive."""

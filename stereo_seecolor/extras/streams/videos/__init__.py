"""Two videos as the two sides of a dive: their clocks, and which of their frames are pairs."""

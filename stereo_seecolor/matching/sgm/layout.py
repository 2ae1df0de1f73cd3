"""The memory layout of matching costs, shared by the search and its steps.

A piece is the costs of one pixel for LANES disparities, one byte each. A block is the pieces of PIXELS pixels, which one step
works on. The costs of a row lie tile by tile, in a tile LANES disparities by LANES, in these pixel by pixel.
"""

LANES, PIXELS, TILE = 16, 4, 8
"""TILE: edge of a tile, pixels; all pixels of a tile search the same disparities."""
BLOCK = LANES * PIXELS
FAR = 0xFF
"""Cost of what lies outside a band; sums with it stay at it."""
P1_SHIFT = 2
"""P1 is P2 >> P1_SHIFT, a quarter of it: where surfaces end, they may also bend."""
WINDOW = 2 * LANES
"""Pixels of the right image that a row of a tile can meet with LANES disparities, rounded up."""

"""Frames with poses to one colored surface."""

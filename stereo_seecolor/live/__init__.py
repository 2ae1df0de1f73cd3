"""Pairs as they arrive: the newest is corrected at once, with the water of the last frames."""

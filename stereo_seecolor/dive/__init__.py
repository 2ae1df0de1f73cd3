"""All pairs of a dive: the passes over them, and the work of each pass on one frame."""

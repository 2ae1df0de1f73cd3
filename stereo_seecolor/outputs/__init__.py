"""The run folder and everything written into it."""

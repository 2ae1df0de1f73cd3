"""Frames and poses -> one map of the reef."""

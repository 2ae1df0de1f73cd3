"""The work of each command, as plain functions."""

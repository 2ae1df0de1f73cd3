"""What the commands of this extra do, as plain functions."""

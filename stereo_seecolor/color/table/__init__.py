"""Counting an image's colors over range: the moment table."""

"""Removes a known water from an image."""

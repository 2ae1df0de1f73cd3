"""Exports of a fused run for other programs; one module for each format."""

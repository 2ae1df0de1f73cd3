"""Markers on the bottom: found in the frames of a run, placed in its map, compared with their known
sizes and places.
"""

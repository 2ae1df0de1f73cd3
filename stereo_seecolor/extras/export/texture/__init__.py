"""Texturing of the map's surface: fewer triangles within a bound, each with its best view, seams
leveled.
"""

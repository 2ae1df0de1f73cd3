"""The images of a run on the surface of its map: the view that shows each triangle best, and pages
of texture.
"""

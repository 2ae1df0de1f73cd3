"""Points, lengths, areas and profiles on the surface that a frame shows, each with its standard
error.
"""

"""All pairs of a dive: the passes over them (``passes``), and the work of each pass on one frame
(``frames``).
"""

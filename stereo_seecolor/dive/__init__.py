"""All pairs of a dive: the passes over them (``passes``), and what each pass does with one frame
(``frames``).
"""

"""A calibration tested on images of a dive: matched points, vertical disparity, motion, and usual
mistakes.
"""

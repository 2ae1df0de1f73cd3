"""A calibration tested on a dive: matched points, vertical disparity, motion, usual mistakes."""

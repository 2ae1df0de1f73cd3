"""Stereo pairs of a reef in, metric range maps, true-colour images and coloured 3-D maps out."""

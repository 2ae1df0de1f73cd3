"""Stereo matching: from a rectified StereoFrame to its RangeMap."""

"""StereoFrame -> RangeMap."""

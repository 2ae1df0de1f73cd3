"""One file a format; each has read(path) -> StereoRig and, where it makes sense, write."""

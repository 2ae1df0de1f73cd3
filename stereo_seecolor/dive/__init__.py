"""All pairs of a dive: two passes over them (``passes``), and what each pass does with one frame (``frame_stages``)."""

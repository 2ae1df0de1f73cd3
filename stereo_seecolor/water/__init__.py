"""The water between camera and reef: parameters, limits, and Jerlov's optical types."""

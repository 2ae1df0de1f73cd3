"""Light, exposure, and patches of the reef that several frames show."""

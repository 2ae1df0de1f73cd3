"""The light of a dive, from patches of the reef that several frames show."""

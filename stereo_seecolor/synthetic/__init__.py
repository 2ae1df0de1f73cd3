"""A reef with known truth, seen through known water."""

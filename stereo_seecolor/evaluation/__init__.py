"""How good is it: colour charts, known truth, range and cloud errors."""

"""How good is it: color charts, known truth, range and cloud errors."""

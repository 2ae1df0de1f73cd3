"""Metrics of a reef's structure that ecologists publish, with standard errors."""

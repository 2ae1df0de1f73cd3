"""What ecologists publish of a reef's structure, with standard errors."""

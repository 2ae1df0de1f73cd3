"""A synthetic reef with known truth, seen through water: for samples, tests, benchmarks."""

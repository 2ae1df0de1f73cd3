"""A synthetic reef with known truth, rendered through the water: for the samples, the tests, the
benchmarks.
"""

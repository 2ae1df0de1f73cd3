"""Runs work on threads of this machine or on a cluster, with compiled kernels and bounded
memory.
"""

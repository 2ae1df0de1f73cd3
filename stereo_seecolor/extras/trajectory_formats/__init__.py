"""Trajectories of single vehicles and programs, added by the entry points of pyproject.toml as the
formats of other packages are.
"""

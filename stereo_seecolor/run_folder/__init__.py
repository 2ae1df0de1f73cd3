"""The output folder of a run: every name inside it, its finished results, and functions that read
them.
"""

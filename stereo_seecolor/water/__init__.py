"""The water between camera and reef: its parameters, their limits, and Jerlov's optical water
types.
"""

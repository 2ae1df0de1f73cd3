"""Ecology of a fused run: metrics of structure, colonies and cover, change between two surveys,
lengths and areas, markers.
"""

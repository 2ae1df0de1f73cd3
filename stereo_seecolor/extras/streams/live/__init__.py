"""Corrects pairs as they arrive: always the newest, with the water of the last frames."""

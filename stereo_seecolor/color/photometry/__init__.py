"""Lights, exposure and points seen from several frames."""

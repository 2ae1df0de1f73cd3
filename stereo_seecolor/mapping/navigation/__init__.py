"""Poses that a vehicle gives, compared with what the pictures show."""

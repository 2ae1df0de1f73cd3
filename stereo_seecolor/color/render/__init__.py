"""Taking a known water out of an image."""

"""Semi-global matching."""

"""A fused run in the forms that other programs open; one module a format."""

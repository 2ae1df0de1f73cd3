"""Images and ranges -> the water, and the image without it."""

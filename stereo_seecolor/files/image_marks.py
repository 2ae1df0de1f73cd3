"""Marks by which image files and the parts of them are known."""

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8"
JPEG_APP0, JPEG_APP1, JPEG_SCAN = 0xFFE0, 0xFFE1, 0xFFDA
"""Markers of segments (ITU T.81)."""
EXIF_PREFIX = b"Exif\x00\x00"
"""Before the EXIF block of a JPEG."""

"""The ground floor: file formats and atomic writes."""

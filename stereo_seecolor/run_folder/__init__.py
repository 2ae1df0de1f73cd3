"""The output folder of a run: names in it, finished results, and functions to read them."""

"""The page of a run, OUT/index.html: what it shows, and the files that it shows it from."""

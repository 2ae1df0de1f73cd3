"""Two surveys of one site: registered, and what changed between them."""

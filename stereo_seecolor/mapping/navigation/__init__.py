"""Given poses: which frame has which, and whether they agree with the images."""

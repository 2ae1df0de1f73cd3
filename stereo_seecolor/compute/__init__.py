"""Runs work on this machine's threads or a cluster, with compiled kernels and bounded memory."""

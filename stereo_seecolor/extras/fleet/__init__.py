"""Many machines and many dives: clusters, shards and their merge, campaigns, plans, the state of
runs.
"""

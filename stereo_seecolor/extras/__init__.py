"""What the core never imports: it is reached through the entry points of pyproject.toml, as the
parts of a third party are.
"""

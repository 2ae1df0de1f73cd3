"""Extras, which the core never imports: it loads them through the entry points of pyproject.toml,
like packages of third parties.
"""

"""Hashes that tell whether a result is up to date."""

import hashlib
import json


def content_key(*parts: object) -> str:
    """A hash of everything that an output depends on; equal parts give equal keys, on any machine."""
    digest = hashlib.sha256()
    for part in parts:
        content = part if isinstance(part, bytes) else json.dumps(part, sort_keys=True, default=str).encode()
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()

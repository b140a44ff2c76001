"""What a shared page holds: its header and its arrays."""

from __future__ import annotations

import re

from mechviz.outputs.page.pack import unpack


def content(page: str):
    """Header and arrays of a page."""
    (text,) = re.findall(r'<script type="application/octet-stream" id="data">(.*?)</script>', page, flags=re.DOTALL)
    return unpack(text)

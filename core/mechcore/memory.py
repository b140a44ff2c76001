"""Keep freed memory for the next arrays instead of giving it back to the system.

The C library of Linux (glibc) gives the end of its heap back as soon as 128 kB there are free. Arrays over a few thousand frames
then come from the system anew with every run, page by page, and each page is zeroed on first touch: that costs two to four times as
much as the arithmetic. How much is kept adapts to the largest block that the program has freed (mallopt(3), "dynamic mmap
threshold"). So one block is taken and freed, once; it is never touched and costs no memory. Whoever sets glibc's thresholds by its
environment variables switches the adaptation off, and nothing changes; other C libraries do not care.
"""

from __future__ import annotations

from functools import cache

import numpy as np

__all__ = ["keep_freed_memory"]

LARGEST = 2**25  # glibc adapts up to blocks of 32 MiB, and then keeps twice as much


@cache
def keep_freed_memory() -> None:
    """Let the C library keep up to 64 MiB of freed memory for the next arrays; once per process."""
    np.empty(LARGEST - 2**16, np.uint8)

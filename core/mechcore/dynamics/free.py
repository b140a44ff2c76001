"""A free coordinate stands among the laws, so that whoever looks at a drive can tell it without loading what integrates it."""

from ..laws.free import Free

__all__ = ["Free"]

"""Equations of motion: masses and forces reduced to coordinates on the configuration curve or in coordinate charts."""

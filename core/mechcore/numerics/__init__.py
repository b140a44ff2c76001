"""Numerical methods that know nothing of mechanisms: interpolation, Newton, Chebyshev series, Taylor arithmetic."""

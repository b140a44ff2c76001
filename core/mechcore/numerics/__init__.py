"""Numerical methods independent of mechanisms: interpolation, Newton's method, Chebyshev series, Taylor arithmetic."""

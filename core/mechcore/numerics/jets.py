"""Arithmetic of functions given by their derivatives (jets): arrays (order + 1, ...), row k holds the k-th derivative."""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

Jet = NDArray[Any]  # real or complex (order + 1, ...)


def jet_product(a: Jet, b: Jet) -> Jet:
    """a b by Leibniz' rule, to the lower of both orders."""
    n = min(len(a), len(b))
    out = np.zeros((n, *np.broadcast_shapes(a.shape[1:], b.shape[1:])), np.result_type(a, b))
    for k in range(n):
        for j in range(k + 1):
            out[k] += comb(k, j) * a[j] * b[k - j]
    return out


def quotient(a: Jet, b: Jet) -> Jet:
    """a / b, to the lower of both orders."""
    n = min(len(a), len(b))
    out = np.zeros((n, *np.broadcast_shapes(a.shape[1:], b.shape[1:])), np.result_type(a, b, float))
    for k in range(n):
        rest = a[k] - sum((comb(k, j) * out[j] * b[k - j] for j in range(k)), start=np.zeros_like(out[0]))
        out[k] = rest / b[0]
    return out


def root(a: Jet) -> Jet:
    """Square root of a positive function."""
    out = np.zeros_like(a)
    out[0] = np.sqrt(a[0])
    for k in range(1, len(a)):
        rest = a[k] - sum((comb(k, j) * out[j] * out[k - j] for j in range(1, k)), start=np.zeros_like(out[0]))
        out[k] = rest / (2.0 * out[0])
    return out


def exponential(a: Jet) -> Jet:
    """exp(a): e' = a' e."""
    out = np.zeros_like(a, dtype=np.result_type(a, float))
    out[0] = np.exp(a[0])
    for k in range(1, len(a)):
        out[k] = sum((comb(k - 1, j) * a[j + 1] * out[k - 1 - j] for j in range(k)), start=np.zeros_like(out[0]))
    return out


def dot(a: Jet, b: Jet) -> Jet:
    """Scalar product of plane vectors written as complex numbers."""
    return np.real(jet_product(np.conj(a), b))


def jet_cross(a: Jet, b: Jet) -> Jet:
    """a x b of plane vectors written as complex numbers."""
    return np.imag(jet_product(np.conj(a), b))


def size(a: Jet) -> Jet:
    """Length of a plane vector, which must not be zero."""
    return root(dot(a, a))


def unit(a: Jet) -> Jet:
    """Unit vector of a plane vector, which must not be zero."""
    return quotient(a, size(a))


def compose(outer: Jet, inner: Jet) -> Jet:
    """Derivatives of f(g(t)) from those of f at g (k, ...) and of g (k, ...), to third order (Faa di Bruno)."""
    n = min(len(outer), len(inner))
    out = [outer[0]]
    if n > 1:
        out.append(outer[1] * inner[1])
    if n > 2:
        out.append(outer[2] * inner[1] ** 2 + outer[1] * inner[2])
    if n > 3:
        out.append(outer[3] * inner[1] ** 3 + 3.0 * outer[2] * inner[1] * inner[2] + outer[1] * inner[3])
    return np.array(out)

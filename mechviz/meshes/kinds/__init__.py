"""Solids of the kinds of joints and of the parts that belong to them."""

"""Solids of the kinds of joints and of what they bring along."""

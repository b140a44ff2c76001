"""Automata: drawings and words become machines that draw them."""

"""Section forces: what a link carries inside, from all that acts on it."""

"""One file a joint: the constraints and couplings that it makes. `parts.KINDS` lists them."""

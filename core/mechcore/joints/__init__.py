"""Joints by families: the constraints and couplings that each makes. `parts.KINDS` lists them."""

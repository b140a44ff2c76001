"""Joints by families: the constraints and couplings that each makes. `registry.JOINT_KINDS` lists them."""

"""Joints by families: the constraints and relations of each kind. `registry.JOINT_KINDS` lists the kinds."""

"""Exact derivatives of motions and forces by parameters: of prescribed motions, and of motions under forces."""

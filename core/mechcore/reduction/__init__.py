"""Reduction: of force systems, of inertia forces, of bodies to point masses, of mechanisms to one link, of shaking to the frame."""

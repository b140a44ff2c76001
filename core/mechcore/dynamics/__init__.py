"""Forward dynamics: motion under forces, on the configuration curve (one freedom) or in charts of its surface (several).

mechanism = Mechanism(..., drives=(Drive(joint="A", law=Free(start=0.0, speed=10.0)),), effects=("inertia", "gravity"))
simulation = simulate(mechanism, 2.0, tolerance=1e-9)
motion = simulation.motion(np.linspace(0.0, 2.0, 361))
forces = simulation.forces(motion)
"""

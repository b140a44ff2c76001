"""Position servos: two controlled joints of an arm under gravity, and how far they are from their targets at the end."""

import mechviz as mv

run = mv.run("servo-arm", frames=120)
print(*(key for key in run if key.startswith("servo.")), sep="\n")

shoulder = run["joint.A.angle"][:, 0]
print(f"The shoulder is to reach 60°: it overshoots to {shoulder.max():.2f}° and ends at {shoulder[-1]:.2f}°.")

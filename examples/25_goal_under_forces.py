"""A goal of a motion under forces: the oil that calms a sprung carriage soonest, although it strikes a stop on its way."""

import mechviz as mv
from mechviz.studies.designs.optimise import Search, optimise
from mechviz.studies.designs.problem import problem_of

CARRIAGE = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "2 s", frames = 80 }
parameters = { oil = { value = "4 N s/m", range = ["1 N s/m", "40 N s/m"] } }
goal = { minimise = "joint.O.displacement:rms" }
[links]
frame = { points = { O = [0, 0], W = [-1000, 0] } }
carriage = { points = { O = [0, 0], E = [0, 0] }, mass = "2 kg", centre = [0, 0], inertia = "1 kg m^2" }
[joints.O]
prismatic = ["frame", "carriage"]
along = [1, 0]
free = { position = 300 }
stops = [{ at = -50, side = "lower", restitution = 0.5, name = "buffer" }]
[loads]
spring = { spring = ["frame.W", "carriage.E"], stiffness = "50 N/m", free_length = 1000 }
oil = { viscous = "O", linear = "oil" }
"""

# derivatives go through the blow on the buffer, so that the search ends with steps along them
optimum = optimise(Search(problem_of(mv.loads(CARRIAGE)), population=5, generations=0))
for line in optimum.lines():
    print("  ".join(line))
assert not optimum.search.refused and optimum.search.evaluations < 200

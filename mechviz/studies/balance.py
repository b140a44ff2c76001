"""Counterweights for a scene: computed, compared with the scene as it is, and written into it as point masses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mechcore.errors import Fault
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.balancing import Counterweight, Shaking, counterweights, find_linkage, shaking
from mechviz.scene.faults import SceneError, in_scene_words

if TYPE_CHECKING:
    from mechviz.scene.annotations import Place
    from mechviz.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Balance:
    """A balanced scene with its counterweights, and the shaking force before and after."""

    scene: Scene
    weights: tuple[Counterweight, ...]
    motion: Motion
    before: Shaking
    after: Shaking

    def lines(self) -> list[str]:
        """The comparison in words."""
        out = [f"{w.link}: {w.mass:.6g} kg at ({w.at[0]:.6g}, {w.at[1]:.6g}) m of its frame" for w in self.weights] or [
            "no counterweight is needed"
        ]
        out.append(f"{'':<16}{'before':>14}{'after':>14}")
        rows = (
            ("peak force [N]", self.before.peak, self.after.peak),
            ("rms force [N]", self.before.rms, self.after.rms),
            ("peak moment [N m]", self.before.peak_moment, self.after.peak_moment),
            ("rms moment [N m]", self.before.rms_moment, self.after.rms_moment),
        )
        return out + [f"{name:<18}{a:>12.5g}{b:>14.5g}" for name, a, b in rows]


@in_scene_words
def balance_scene(
    scene: Scene, *, radius: float | None = None, rocker_radius: float | None = None, fraction: float | None = None
) -> Balance:
    """Counterweights for a four-bar or slider-crank. Radii [m] and fraction are those of the scene's ``shaking.counterweights``
    where they are not given. Raises `SceneError` where there is no radius, `MechanismError` where the mechanism is another one."""
    asked = scene.mechanism.studies.shaking
    known = None if asked is None else asked.radii
    if radius is None and known is None:
        remedy = 'Add --radius, or shaking = { counterweights = { radius = "60 mm" } } to the scene.'
        raise SceneError(scene.name, Fault("shaking.counterweights", "how far from the pivots may the counterweights be?", remedy))
    first = radius if radius is not None else known[0] if known else 0.0
    second = rocker_radius if rocker_radius is not None else radius if radius is not None else known[1] if known else first
    share = fraction if fraction is not None else asked.fraction if asked is not None else 1.0
    if not 0.0 <= share <= 1.0:
        raise SceneError(scene.name, Fault("fraction", f"{share:g} is not between 0 and 1.", "Give 0.5 for half."))
    weights = counterweights(find_linkage(scene.mechanism), (first, second), fraction=share)
    changes: dict[Place, Any] = {}
    for w in weights:
        place = ("links", w.link, "lumps")
        lump = {"mass": f"{w.mass!r} kg", "at": [f"{x!r} m" for x in w.at]}
        changes[place] = [*changes.get(place, scene.document.links[w.link].lumps), lump]
    if scene.document.shaking is not None:
        changes["shaking", "counterweights"] = None
    better = scene.changed(changes)
    about = (0.0, 0.0) if asked is None else asked.about
    motion = _moved(scene)
    return Balance(better, weights, motion, shaking(motion, about), shaking(_moved(better), about))


def _moved(scene: Scene) -> Motion:
    mechanism = scene.mechanism
    return solve_motion(compile_mechanism(mechanism), default_times(mechanism, scene.frames, scene.cycles))

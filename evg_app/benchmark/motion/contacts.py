"""The judge: PyBullet's contact points between the arm and anything else, step by step."""

from dataclasses import dataclass

import numpy as np

from evg_app.simulation.world import SimWorld

SAME_PLACE = 1e-6
"""A static body is the declared box whose centre is this close [m]."""


@dataclass(frozen=True)
class Contact:
    """One pair that touched during one phase of a pick.

    Attributes:
        phase: motion under way.
        link: of the robot.
        other: object ("2:cup"), declared box, bin part or "table".
        depth: deepest penetration [m]; small and negative for a touch without penetration.
        time: simulated time after the start of the pick when they first touched [s].
    """

    phase: str
    link: str
    other: str
    depth: float
    time: float


class ContactJudge:
    """Collects contacts of the robot while `watching`. Looks before every step at what the last step left."""

    def __init__(self, world: SimWorld) -> None:
        """Register with the world; call `begin` before a pick."""
        self._world = world
        self._links = self._link_names()
        self._others = _names(world)
        self._found: dict[tuple[str, str, str], tuple[float, float]] = {}
        self._start, self.phase = 0.0, ""
        world.before_step.append(self._look)

    def begin(self) -> None:
        """Forget what was found; nothing is watched until `phase` is set."""
        self._found, self._start, self.phase = {}, self._world.time, ""

    def contacts(self) -> tuple[Contact, ...]:
        """What touched since `begin`, in order of time."""
        found = [Contact(*key, depth, time) for key, (depth, time) in self._found.items()]
        return tuple(sorted(found, key=lambda c: c.time))

    def name_of(self, index: int) -> str:
        """How contacts call object `index` of the scene."""
        return f"{index}:{self._world.placed[index].model.name}"

    def _look(self) -> None:
        """Note what touches now."""
        if not self.phase:
            return
        for point in self._world.client.getContactPoints(bodyA=self._world.robot.body):
            distance, force = float(point[8]), float(point[9])
            if point[2] == self._world.robot.body or (force <= 0.0 and distance > 0.0):
                continue
            key = (self.phase, self._links[int(point[3])], self._others[int(point[2])])
            depth, time = self._found.get(key, (-np.inf, self._world.time - self._start))
            self._found[key] = (max(depth, -distance), time)

    def _link_names(self) -> dict[int, str]:
        """Names of the robot's links by PyBullet's index."""
        client, body = self._world.client, self._world.robot.body
        names = {k: client.getJointInfo(body, k)[12].decode() for k in range(client.getNumJoints(body))}
        return {-1: client.getBodyInfo(body)[0].decode(), **names}


def _names(world: SimWorld) -> dict[int, str]:
    """What every body but the robot is called."""
    boxes = [*world.robot_config.drop.walls(), *(model.box() for model in world.robot_config.obstacles)]
    names = {thing.body: f"{k}:{thing.model.name}" for k, thing in enumerate(world.placed)}
    for number in range(world.client.getNumBodies()):
        body = int(world.client.getBodyUniqueId(number))
        if body in names or body == world.robot.body:
            continue
        place = np.array(world.client.getBasePositionAndOrientation(body)[0])
        near = [box.name for box in boxes if np.abs(place - box.center).max() < SAME_PLACE]
        names[body] = near[0] if near else "table"
    return names

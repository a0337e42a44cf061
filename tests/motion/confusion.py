"""Our collision checks against PyBullet's contacts on random configurations, and against coal in time.

`python tests/motion/confusion.py SCENES CONFIGURATIONS` writes the table of docs/motion.md.
"""

import json
import sys
import time

import coal
import numpy as np

from evg_app.config.files import load_robot
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.field import DistanceField
from evg_app.motion.scene import Boxes, Plane, Scene
from evg_app.simulation.bullet import connect, static_box
from evg_app.simulation.panda import load_robot as load_body
from evg_app.types import Box

VOXEL, SIZE = 0.0125, 80
ORIGIN = np.array([0.0, -0.5, 0.0])
NO_TABLE = Plane(np.array([0.0, 0.0, 1.0]), -9.0)
NEAR = 0.05
BENT = np.array([0.0, 0.2, 0.0, -1.8, 0.0, 2.0, 0.8])
ROBOT = load_robot("panda")


def random_boxes(rng):
    """Six boxes around the arm: (size, centre)."""
    return [
        (rng.uniform(0.04, 0.2, 3), np.array([*rng.uniform([0.1, -0.45], [0.75, 0.45]), rng.uniform(0.1, 0.8)]))
        for _ in range(6)
    ]


def configurations(planner, rng, count):
    """Half over the whole range, half bent forwards among the boxes."""
    k = planner.kinematics
    q = rng.uniform(k.lower, k.upper, (count, 7))
    q[::2] = np.clip(BENT + rng.normal(0, 0.7, (len(q[::2]), 7)), k.lower, k.upper)
    return q


def seen_voxels(boxes):
    """Voxels that the boxes' surfaces pass through."""
    axes = np.meshgrid(*[np.arange(SIZE)] * 3, indexing="ij")
    centers = ORIGIN + (np.stack(axes, -1) + 0.5) * VOXEL
    occupied = np.zeros((SIZE,) * 3, dtype=bool)
    for size, center in boxes:
        q = np.abs(centers - center) - size / 2
        distance = np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)
        occupied |= np.abs(distance) <= 0.6 * VOXEL
    return occupied


def scenes_of(boxes):
    """The same world as declared boxes, and as observed voxels."""
    declared = Boxes.of(tuple(Box(str(k), tuple(size), tuple(center)) for k, (size, center) in enumerate(boxes)))
    field = DistanceField(seen_voxels(boxes), ORIGIN, VOXEL)
    nothing = np.zeros((0, 3))
    return {"boxes": Scene(nothing, None, declared, NO_TABLE), "voxels": Scene(nothing, field, Boxes.of(()), NO_TABLE)}


class Bullet:
    """PyBullet's answer for one world."""

    def __init__(self, planner, boxes):
        self.client = connect(False, 50)
        self.body = load_body(self.client, ROBOT)
        self.ids = [static_box(self.client, size, center, (1, 0, 0, 1), 0.5) for size, center in boxes]
        links = range(-1, self.client.getNumJoints(self.body.body))
        names = {k: "panda_link0" if k < 0 else self.client.getJointInfo(self.body.body, k)[12].decode() for k in links}
        checked = planner.checker.self_collision.pairs()
        self.pairs = [(a, b) for a in links for b in links if a < b and frozenset((names[a], names[b])) in checked]

    def touches(self, q):
        """Whether a moving link touches a box, and whether the arm touches itself."""
        for joint, value in zip(self.body.joints, q, strict=True):
            self.client.resetJointState(self.body.body, joint, value)
        points = self.client.getClosestPoints
        scene = any(p[8] < 0 for k in self.ids for p in points(self.body.body, k, NEAR) if p[3] >= 0)
        own = any(p[8] < 0 for a, b in self.pairs for p in points(self.body.body, self.body.body, 0.01, a, b))
        return scene, own


def confusion(scenes, count, seed=0):
    """Counts [ours hit, PyBullet touches] for each check. Shape (2, 2) each."""
    planner, rng = MotionPlanner(ROBOT), np.random.default_rng(seed)
    table = {name: np.zeros((2, 2), dtype=int) for name in ("boxes", "voxels", "self")}
    for _ in range(scenes):
        boxes, q = random_boxes(rng), configurations(planner, rng, count)
        bullet = Bullet(planner, boxes)
        ours = {name: planner.checker.hits_scene(q, scene) for name, scene in scenes_of(boxes).items()}
        ours["self"] = np.array([planner.checker.self_collision.collides(row) for row in q])
        for k, row in enumerate(q):
            scene, own = bullet.touches(row)
            for name, truth in (("boxes", scene), ("voxels", scene), ("self", own)):
                table[name][int(ours[name][k]), int(truth)] += 1
        bullet.client.disconnect()
    return table


def representations(count=200, seed=0):
    """Milliseconds per configuration of the arm against observed voxels, by representation; and of building it."""
    planner, rng = MotionPlanner(ROBOT), np.random.default_rng(seed)
    boxes, q = random_boxes(rng), configurations(planner, rng, count)
    occupied = seen_voxels(boxes)
    frames = planner.kinematics.frames(q)
    took = {}

    def timed(name, work):
        start = time.process_time()
        result = work()
        took[name] = round((time.process_time() - start) * 1e3, 4)
        return result

    field = timed("build field", lambda: DistanceField(occupied, ORIGIN, VOXEL))
    scene = Scene(np.zeros((0, 3)), field, Boxes.of(()), NO_TABLE)
    planner.checker.hits_scene(q, scene)
    hits = {"field": timed("spheres and field", lambda: planner.checker.hits_scene(q, scene))}
    centers = ORIGIN + (np.argwhere(occupied) + 0.5) * VOXEL
    octree = timed("build octree", lambda: coal.makeOctree(centers, VOXEL))
    moving = [item for item in planner.kinematics.meshes.geometryObjects if int(item.parentJoint) > 0]
    links = [(int(item.parentJoint), item.geometry, np.asarray(item.placement.homogeneous)) for item in moving]

    def against(shape):
        request = coal.CollisionRequest()
        found = []
        for T in frames:
            hit = False
            for frame, mesh, offset in links:
                P = T[frame] @ offset
                result = coal.CollisionResult()
                pose = coal.Transform3s(P[:3, :3], P[:3, 3])
                hit = hit or coal.collide(mesh, pose, shape, coal.Transform3s.Identity(), request, result) > 0
            found.append(hit)
        return np.array(found)

    hits["octree"] = timed("coal BVH and octree", lambda: against(octree))
    for name in ("spheres and field", "coal BVH and octree"):
        took[name] = round(took[name] / count, 4)
    took["octree hits that the field calls free"] = int((hits["octree"] & ~hits["field"]).sum())
    took["configurations"] = count
    return took


if __name__ == "__main__":
    found = confusion(int(sys.argv[1]), int(sys.argv[2]))
    rows = {
        name: {
            "both free": int(t[0, 0]),
            "false free": int(t[0, 1]),
            "false hit": int(t[1, 0]),
            "both hit": int(t[1, 1]),
        }
        for name, t in found.items()
    }
    sys.stdout.write(json.dumps({"confusion": rows, "ms": representations()}, indent=2) + "\n")

"""Generate labelled scenes: every scene is a pure function of (config, unit), every shard of 50 units one file."""

import hashlib
import json
import logging
import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import BadInput
from evg_app.learning.labels import Kind, LabelledGrasps, WithContact, balance, sample_and_label, with_contact
from evg_app.learning.proposals import judge_proposals, propose, try_all
from evg_app.learning.shards import CorruptShard, SceneSample, quantise, read_shard, write_shard
from evg_app.learning.solids import SceneSolids, Solid
from evg_app.learning.surface import half_spaces, sample_occupancy, sample_surface
from evg_app.learning.views import draw_views, scene_grids
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.meshes import hull
from evg_app.simulation.objects import ObjectModel, objects_from_folder
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.scenes import Poisson, SceneError, SceneRecipe, generate_scene_state
from evg_app.simulation.state import SceneObject, SceneState

log = logging.getLogger(__name__)

SHARD_SIZE = 50
"""Scenes per shard."""
VALIDATION_EVERY = 20
"""Shards 0, 20, 40 ... hold scenes of validation objects only; the others of training objects only."""
LABEL_RULE = 3
"""Number of the labelling rule; part of what identifies a data set."""
VALIDATION_SHARE = 46
"""Of 256: share of object names held out for validation."""


@dataclass(frozen=True)
class GenerateConfig:
    """What to generate; together with a unit's number it determines the scene.

    Attributes:
        seed: of everything.
        scenes: how many; rounded up to whole shards.
        packed_folders, pile_folders: object folders (VGN layout) beside the built-in training objects.
        kinds: share of packed, pile and adversarial scenes.
        mean_objects: scenes ask for 1 + Poisson(mean_objects) objects.
        candidates: grasps tried per scene (a third as many again near positives).
        grasps: positives, and negatives, stored per scene at most.
        slip_share: share of the negatives that are collision-free slips, where there are enough.
        points: occupancy samples per scene.
        verified: share of the grasps that physics tries as well; its word counts.
        weights: a network (weights file) whose own proposals are added; None for none.
        proposals: how many of them per scene.
        tries: how many of the proposals that are too close to call for the rule are tried in physics.
    """

    seed: int = 0
    scenes: int = 5000
    packed_folders: tuple[str, ...] = ()
    pile_folders: tuple[str, ...] = ()
    kinds: tuple[float, float, float] = (0.40, 0.45, 0.15)
    mean_objects: float = 4.0
    candidates: int = 2400
    grasps: int = 120
    slip_share: float = 0.35
    points: int = 3072
    verified: float = 0.02
    weights: str | None = None
    proposals: int = 60
    tries: int = 3

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.scenes // SHARD_SIZE)

    def digest(self) -> str:
        """Hash of all that determines a scene (not of how many there are)."""
        fields = {k: v for k, v in asdict(self).items() if k != "scenes"} | {"label_rule": LABEL_RULE}
        fields |= {k: [Path(p).name for p in fields[k]] for k in ("packed_folders", "pile_folders")}
        if self.weights is not None:
            fields["weights"] = hashlib.sha256(Path(self.weights).read_bytes()).hexdigest()
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]


def is_validation(name: str) -> bool:
    """Whether an object of this name is held out for validation, in whatever folder it lies."""
    return hashlib.sha256(name.encode()).digest()[1] < VALIDATION_SHARE


def generate(config: GenerateConfig, out: Path, workers: int = 1) -> int:
    """Write the missing shards of `config` to `out`; a corrupt one is named and made again. Returns how many were made.

    Raises:
        BadInput: an objects folder or `out` cannot be used, or `out` holds shards of another config.
    """
    object_pools(config, False)
    missing = [k for k in range(config.shards) if not _is_done(out / shard_name(k), config)]
    log.info("%d of %d shards to make in %s, %d worker(s)", len(missing), config.shards, out, workers)
    jobs = [(config, out, k) for k in missing]
    if workers <= 1:
        for job in jobs:
            make_shard(*job)
        return len(missing)
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        pool.starmap(make_shard, jobs, chunksize=1)
    return len(missing)


def shard_name(index: int) -> str:
    """File name of a shard."""
    return f"shard_{index:05d}.npz"


def make_shard(config: GenerateConfig, out: Path, index: int) -> None:
    """Generate and write shard `index`."""
    start, cpu = time.time(), time.process_time()
    validation = index % VALIDATION_EVERY == 0
    units = range(index * SHARD_SIZE, (index + 1) * SHARD_SIZE)
    scenes = [make_scene(config, unit, validation) for unit in units]
    agreed = agreement([check for scene in scenes for check in scene.verified])
    meta = {
        "config": asdict(config),
        "digest": config.digest(),
        "validation": validation,
        "cpu_s": time.process_time() - cpu,
        "agreement": agreed,
    }
    write_shard(out / shard_name(index), scenes, meta)
    counts = np.bincount(np.concatenate([s.kind for s in scenes]), minlength=3)
    log.info(
        "%s: %d scenes%s, %d positives, %d slips, %d collisions, %.2f CPU-s and %.2f s per scene; physics agrees: %s",
        shard_name(index),
        len(scenes),
        " (validation)" if validation else "",
        counts[Kind.POSITIVE],
        counts[Kind.SLIP],
        counts[Kind.COLLISION],
        (time.process_time() - cpu) / len(scenes),
        (time.time() - start) / len(scenes),
        ", ".join(f"{name} {good}/{tried}" for name, (good, tried) in agreed.items()),
    )


def agreement(checks: Sequence[tuple[int, int, int, int]]) -> dict[str, tuple[int, int]]:
    """For each kind of label, and for labels with contact allowed: (agreed with physics, tried)."""
    table = np.array(checks, dtype=np.int64).reshape(-1, 4)
    said, found, said_contact, found_contact = table.T
    answer = {k.name.lower(): said == k for k in Kind}
    counts = {name: (int((found[of] == said[of]).sum()), int(of.sum())) for name, of in answer.items()}
    for name, value in (("holds_with_contact", WithContact.HOLDS), ("fails_with_contact", WithContact.FAILS)):
        of = (said_contact == value) & (said == Kind.COLLISION)
        counts[name] = (int((found_contact[of] == value).sum()), int(of.sum()))
    return counts


def make_scene(config: GenerateConfig, unit: int, validation: bool) -> SceneSample:
    """Scene number `unit`: physics, labels, occupancy and noisy views. Scenes that do not settle are drawn again."""
    pools = object_pools(config, validation)
    for attempt in range(20):
        rng = np.random.default_rng([config.seed, unit, attempt])
        kind = str(rng.choice(["packed", "pile", "adversarial"], p=config.kinds))
        objects = _draw_objects(pools, kind, rng)
        recipe = SceneRecipe(kind, Poisson(config.mean_objects))
        try:
            state = generate_scene_state(recipe, objects, int(rng.integers(2**31)))
        except SceneError:
            continue
        if state.objects:
            return _sample(config, state, f"{kind}/{unit}", rng)
    raise BadInput(f"scene {unit} did not settle in 20 attempts; check the object folders")


def solids_of(state: SceneState) -> list[Solid]:
    """The convex pieces that physics collides with, in the task frame."""
    solids = []
    for owner, thing in enumerate(state.objects):
        for part in thing.parts():
            mesh = hull(part.vertices)
            solids.append(Solid(owner, mesh.vertices, mesh.faces))
    return solids


def _sample(config: GenerateConfig, state: SceneState, name: str, rng: np.random.Generator) -> SceneSample:
    """Label and render one settled scene."""
    solids = solids_of(state)
    scene, planes = SceneSolids(solids), half_spaces(solids)
    surface = sample_surface(solids, planes, config.candidates, rng)
    labelled = sample_and_label(scene, surface, config.candidates, rng)
    positives = labelled.T_task_grasp[labelled.kind == Kind.POSITIVE, :3, 3]
    chosen = balance(labelled, config.grasps, config.slip_share, rng)
    contact = with_contact(scene, chosen)
    chosen, contact, checks = _verify(state, chosen, contact, config.verified, rng)
    points, occupied = sample_occupancy(surface, planes, config.points, rng)
    views = draw_views(rng)
    grids = quantise(scene_grids(SceneCaster(state), views, rng))
    proposed = np.zeros(len(chosen.kind), dtype=np.bool_)
    if config.weights is not None:
        T = propose(config.weights, grids.astype(np.float32) / np.float32(255.0), config.proposals, rng)
        tried, tried_contact = judge_proposals(scene, state, T, config.tries)
        chosen, contact = chosen.join(tried), np.concatenate([contact, tried_contact])
        proposed = np.concatenate([proposed, np.ones(len(tried_contact), dtype=np.bool_)])
    return SceneSample(
        grids=grids,
        views=tuple("/".join(v) for v in views),
        rows=_f32(chosen.T_task_grasp[:, :2, :3].reshape(-1, 6)),
        position=_f32(chosen.T_task_grasp[:, :3, 3]),
        width=_f32(chosen.width),
        kind=chosen.kind,
        contact=contact,
        proposed=proposed,
        positives=positives.astype(np.float16),
        points=points,
        occupied=occupied,
        name=name,
        objects=tuple(o.name for o in state.objects),
        placement=tuple(_placement(o) for o in state.objects),
        verified=checks,
    )


def _verify(
    state: SceneState,
    grasps: LabelledGrasps,
    contact: NDArray[np.uint8],
    share: float,
    rng: np.random.Generator,
) -> tuple[LabelledGrasps, NDArray[np.uint8], tuple[tuple[int, int, int, int], ...]]:
    """Try a share of the grasps in physics, whose word counts; and for each what was said and what was found."""
    chosen = rng.permutation(len(grasps.kind))[: round(share * len(grasps.kind))]
    tried, found = try_all(state, grasps.T_task_grasp[chosen])
    checks = tuple(
        (int(a), int(b), int(c), int(d))
        for a, b, c, d in zip(grasps.kind[chosen], tried.kind, contact[chosen], found, strict=True)
    )
    kind, width, contact = grasps.kind.copy(), grasps.width.copy(), contact.copy()
    kind[chosen], contact[chosen] = tried.kind, found
    width[chosen] = np.where(tried.kind == Kind.POSITIVE, tried.width, 0.08)
    return LabelledGrasps(grasps.T_task_grasp, kind, width, grasps.owner), contact, checks


def _placement(thing: SceneObject) -> tuple[str, float, tuple[float, ...]]:
    """Which object it is ("parent/folder/name"), its scale, and the rows of its pose rounded to a micrometre."""
    pose = tuple(round(float(x), 6) for x in thing.T_task_object[:3].ravel())
    return f"{thing.urdf.parent.parent.name}/{thing.urdf.parent.name}/{thing.name}", round(thing.scale, 6), pose


Pools = dict[str, list[tuple[ObjectModel, ...]]]


@lru_cache(maxsize=4)
def object_pools(config: GenerateConfig, validation: bool) -> Pools:
    """For each scene kind the object sets to draw from: built-in first, then the folders' (where there are any).

    Raises:
        BadInput: a folder cannot be used.
    """

    def half(objects: Sequence[ObjectModel]) -> tuple[ObjectModel, ...]:
        return tuple(o for o in objects if is_validation(o.name) == validation)

    builtin = half(builtin_objects("train"))
    packed = half([o for f in config.packed_folders for o in objects_from_folder(Path(f))])
    pile = half([o for f in config.pile_folders for o in objects_from_folder(Path(f))])
    return {
        kind: [tuple(o for o in builtin if kind in o.kinds), *([extra] if extra else [])]
        for kind, extra in (("packed", packed), ("pile", pile), ("adversarial", ()))
    }


def _draw_objects(pools: Pools, kind: str, rng: np.random.Generator) -> tuple[ObjectModel, ...]:
    """One set of objects for a scene: built-in, from folders, or (one in ten) both."""
    sets = pools[kind]
    if len(sets) > 1 and rng.random() < 0.1:
        return tuple(o for s in sets for o in s)
    return sets[int(rng.integers(len(sets)))]


def _is_done(path: Path, config: GenerateConfig) -> bool:
    """Whether the shard exists and belongs to `config`.

    Raises:
        BadInput: it belongs to another config.
    """
    if not path.exists():
        return False
    try:
        _, meta = read_shard(path)
    except CorruptShard as error:
        log.warning("%s", error)
        return False
    if meta["digest"] != config.digest():
        raise BadInput(
            f"{path} was made with other settings ({meta['digest']} != {config.digest()}); use another --out"
        )
    return True


def _f32(a: NDArray[np.float64]) -> NDArray[np.float32]:
    return a.astype(np.float32)

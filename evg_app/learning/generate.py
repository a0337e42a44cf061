"""Generate labelled scenes: every scene is a pure function of (config, unit), every shard of 50 units one file."""

import hashlib
import json
import logging
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evg_app.errors import BadInput
from evg_app.learning.labels import Kind, balance, sample_and_label, with_contact
from evg_app.learning.pools import draw_objects, object_pools
from evg_app.learning.proposals import judge_proposals, propose
from evg_app.learning.shards import CorruptShard, SceneSample, quantise, read_shard, write_shard
from evg_app.learning.solids import SceneSolids, Solid
from evg_app.learning.surface import half_spaces, sample_occupancy, sample_surface
from evg_app.learning.verification import Agreement, agreement, verify
from evg_app.learning.views import draw_views, scene_grids
from evg_app.simulation.meshes import hull
from evg_app.simulation.rendering import SceneCaster
from evg_app.simulation.scenes import Poisson, SceneError, SceneRecipe, generate_scene_state
from evg_app.simulation.state import SceneObject, SceneState

log = logging.getLogger(__name__)

SHARD_SIZE = 50
"""Scenes per shard."""
VALIDATION_EVERY = 20
"""Shards 0, 20, 40 ... hold scenes of validation objects only; the others of training objects only."""
KINDS = ("packed", "pile", "adversarial", "toppled")
"""Scenes to train on. Toppled: objects that usually stand, thrown: what a failed grasp in a packed scene leaves."""
PACKED_SCALES = (0.7, 1.0)
"""Of packed and toppled scenes; the protocol's end at 0.9. Some objects must be too large for the hand."""
LABEL_RULE = 3
"""Number of the labelling rule; part of what identifies a data set."""


@dataclass(frozen=True)
class GenerateConfig:
    """What to generate; together with a unit's number it determines the scene.

    Attributes:
        seed: of everything.
        scenes: how many; rounded up to whole shards.
        packed_folders, pile_folders: object folders (VGN layout) beside the built-in training objects.
        kinds: share of the scenes of each of `KINDS`.
        mean_objects: scenes ask for 1 + Poisson(mean_objects) objects, toppled ones for half as many more than one.
        candidates: grasps tried per scene (a third as many again near positives).
        grasps: positives, and negatives, stored per scene at most.
        slip_share: share of the negatives that are collision-free slips, where there are enough.
        points: occupancy samples per scene.
        verified: share of the grasps that physics tries as well; its word counts.
        weights: a network (weights file) whose own proposals are added; None for none.
        proposals: how many of them per scene.
        tries: how many of the proposals, best first, are tried in physics; the rule judges the others.
    """

    seed: int = 0
    scenes: int = 5000
    packed_folders: tuple[str, ...] = ()
    pile_folders: tuple[str, ...] = ()
    kinds: tuple[float, float, float, float] = (0.30, 0.35, 0.10, 0.25)
    mean_objects: float = 4.0
    candidates: int = 2400
    grasps: int = 120
    slip_share: float = 0.35
    points: int = 3072
    verified: float = 0.02
    weights: str | None = None
    proposals: int = 60
    tries: int = 9

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


@dataclass(frozen=True)
class ShardReport:
    """What is in a shard that was just made.

    Attributes:
        name: of its file.
        scenes, positives, slips, collisions: how many.
        cpu_s: what it took [s of one core].
        agreement: of its labels with physics.
    """

    name: str
    scenes: int
    positives: int
    slips: int
    collisions: int
    cpu_s: float
    agreement: Agreement


def generate(
    config: GenerateConfig,
    out: Path,
    workers: int = 1,
    progress: Callable[[ShardReport, int, int], None] = lambda report, done, shards: None,
) -> int:
    """Write the missing shards of `config` to `out`; a corrupt one is named and made again. Returns how many were made.

    `progress` is told of every shard, with how many of how many are done. Interrupted, the shards under way are lost.

    Raises:
        BadInput: an objects folder or `out` cannot be used, or `out` holds shards of another config.
    """
    object_pools(config.packed_folders, config.pile_folders, False)
    missing = [k for k in range(config.shards) if not _is_done(out / shard_name(k), config)]
    jobs = [(config, out, k) for k in missing]
    for number, report in enumerate(_made(jobs, workers), start=1):
        progress(report, number, len(jobs))
    return len(missing)


Job = tuple[GenerateConfig, Path, int]


def _made(jobs: list[Job], workers: int) -> Iterator[ShardReport]:
    """The shards' reports as they are made."""
    if workers <= 1:
        yield from (_make(job) for job in jobs)
        return
    with multiprocessing.get_context("spawn").Pool(workers, _leave_interrupts_to_the_parent) as pool:
        yield from pool.imap_unordered(_make, jobs)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _make(job: Job) -> ShardReport:
    return make_shard(*job)


def shard_name(index: int) -> str:
    """File name of a shard."""
    return f"shard_{index:05d}.npz"


def make_shard(config: GenerateConfig, out: Path, index: int) -> ShardReport:
    """Generate and write shard `index`."""
    cpu = time.process_time()
    validation = index % VALIDATION_EVERY == 0
    units = range(index * SHARD_SIZE, (index + 1) * SHARD_SIZE)
    scenes = [make_scene(config, unit, validation) for unit in units]
    agreed = agreement([check for scene in scenes for check in scene.verified])
    used = time.process_time() - cpu
    meta = {"config": asdict(config), "digest": config.digest(), "validation": validation, "cpu_s": used}
    write_shard(out / shard_name(index), scenes, meta | {"agreement": agreed})
    counts = np.bincount(np.concatenate([s.kind for s in scenes]), minlength=3)
    return ShardReport(
        name=shard_name(index),
        scenes=len(scenes),
        positives=int(counts[Kind.POSITIVE]),
        slips=int(counts[Kind.SLIP]),
        collisions=int(counts[Kind.COLLISION]),
        cpu_s=used,
        agreement=agreed,
    )


def make_scene(config: GenerateConfig, unit: int, validation: bool) -> SceneSample:
    """Scene number `unit`: physics, labels, occupancy and noisy views. Scenes that do not settle are drawn again."""
    pools = object_pools(config.packed_folders, config.pile_folders, validation)
    for attempt in range(20):
        rng = np.random.default_rng([config.seed, unit, attempt])
        kind = str(rng.choice(KINDS, p=config.kinds))
        objects = draw_objects(pools, "packed" if kind == "toppled" else kind, rng)
        recipe = scene_recipe(kind, config.mean_objects)
        try:
            state = generate_scene_state(recipe, objects, int(rng.integers(2**31)))
        except SceneError:
            continue
        if state.objects:
            return _sample(config, state, f"{kind}/{unit}", rng)
    raise BadInput(f"scene {unit} did not settle in 20 attempts; check the object folders")


def scene_recipe(kind: str, mean_objects: float) -> SceneRecipe:
    """How a scene of one of `KINDS` is built."""
    if kind == "packed":
        return SceneRecipe(kind, Poisson(mean_objects), scale_range=PACKED_SCALES)
    if kind == "toppled":
        return SceneRecipe("pile", Poisson(0.5 * mean_objects), scale_range=PACKED_SCALES)
    return SceneRecipe(kind, Poisson(mean_objects))


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
    chosen, contact, checks = verify(state, chosen, contact, config.verified, rng)
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


def _placement(thing: SceneObject) -> tuple[str, float, tuple[float, ...]]:
    """Which object it is ("parent/folder/name"), its scale, and the rows of its pose rounded to a micrometre."""
    pose = tuple(round(float(x), 6) for x in thing.T_task_object[:3].ravel())
    return f"{thing.urdf.parent.parent.name}/{thing.urdf.parent.name}/{thing.name}", round(thing.scale, 6), pose


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

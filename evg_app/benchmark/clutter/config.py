"""What a benchmark measures; together with seed and round number it determines a round."""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from evg_app.errors import BadInput, UnknownName
from evg_app.grasping.load import LEARNED, load_planner
from evg_app.grasping.planner import PlannerConfig
from evg_app.grasping.protocol import Planner
from evg_app.learning.pools import is_validation
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.noise import NOISE_MODELS
from evg_app.simulation.objects import ObjectModel, objects_from_folder, of_kind
from evg_app.simulation.recipes import KINDS
from evg_app.simulation.views import D435I, GIGA_CAMERA
from evg_app.types import Intrinsics

PROTOCOL = 1
"""Number of the protocol's implementation: rounds of different numbers are not mixed."""
VIEWS = {"side": "side", "random": "icgnet", "random-orbitgrasp": "orbitgrasp", "random-igd": "igd"}
"""Names of `--view` and the recipe each stands for (spec §4.3)."""
CAMERAS: dict[str, Intrinsics] = {"d435i": D435I, "giga": GIGA_CAMERA}
"""The camera of the paper's simulator, and that of GIGA, VGN and IGD."""
SPLITS = ("all", "train", "validation")
"""Which objects of a folder: all, or one side of the training's division by name."""


@dataclass(frozen=True)
class BenchmarkConfig:
    """One benchmark.

    Attributes:
        scene: kind of scene.
        view: one of `VIEWS`.
        noise: depth noise model.
        model, weights, device: which planner, as `load_planner` takes them.
        objects: folder of URDFs, or None for the built-in test objects.
        split: one of `SPLITS`.
        count: objects asked for.
        camera: one of `CAMERAS`.
        allow_contact: rank by the score of grasps that may touch on the approach, as this protocol lets them (of the
            networks that have such a score).
        table_ruler: correct depth by the known table first (not the paper's protocol).
    """

    scene: str = "packed"
    view: str = "side"
    noise: str = "gamma"
    model: str = "equiigd"
    weights: str | None = None
    device: str = "cpu"
    objects: str | None = None
    split: str = "all"
    count: int = 5
    camera: str = "d435i"
    allow_contact: bool = True
    table_ruler: bool = False

    def __post_init__(self) -> None:
        known = {
            "scene": KINDS,
            "view": tuple(VIEWS),
            "noise": NOISE_MODELS,
            "camera": tuple(CAMERAS),
            "split": SPLITS,
        }
        for field, names in known.items():
            if getattr(self, field) not in names:
                raise UnknownName(field, str(getattr(self, field)), list(names))
        if self.count < 1:
            raise BadInput(f"a scene of {self.count} objects cannot be cleared; ask for at least 1")

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the simulated camera."""
        return CAMERAS[self.camera]

    def planner(self) -> Planner:
        """The planner under test.

        Raises:
            EvgError: see `load_planner`.
        """
        search = PlannerConfig(allow_contact=self.allow_contact)
        return load_planner(self.model, self.weights, self.device, search)

    def object_models(self) -> tuple[ObjectModel, ...]:
        """The objects that scenes are made of, sorted by name.

        Raises:
            BadInput: the folder cannot be used, or nothing in it fits.
        """
        return _object_models(self.objects, self.scene, self.split)

    def scenes_key(self) -> dict[str, Any]:
        """What determines the scenes, cameras and noise of the rounds, whatever the planner. Plain values."""
        names = ",".join(o.name for o in self.object_models())
        values = {k: getattr(self, k) for k in ("scene", "view", "noise", "count", "camera")}
        return values | {"protocol": PROTOCOL, "objects_sha256": hashlib.sha256(names.encode()).hexdigest()}

    def digest(self, weights_sha256: str) -> str:
        """Hash of all that determines a round beside its seed and number."""
        policy = {"model": self.model, "weights": weights_sha256, "table_ruler": self.table_ruler}
        policy |= {} if self.allow_contact else {"strict": True}
        policy |= {"search": repr(PlannerConfig())} if self.model in LEARNED else {}
        text = json.dumps(self.scenes_key() | policy, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


@lru_cache(maxsize=4)
def _object_models(folder: str | None, scene: str, split: str) -> tuple[ObjectModel, ...]:
    """The objects of a folder, or the built-in ones."""
    found = builtin_objects("test") if folder is None else objects_from_folder(Path(folder))
    if split != "all":
        found = tuple(o for o in found if is_validation(o.name) == (split == "validation"))
    if not found:
        raise BadInput(f"no object of {folder or 'the built-in set'} is in the split '{split}'; use --split all")
    return tuple(sorted(of_kind(found, scene), key=lambda o: o.name))

"""What the motion benchmark measures; together with a seed and a number it determines a scene and all that is done."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.config.models import CameraConfig, RobotConfig, WorldConfig
from evg_app.errors import BadInput
from evg_app.simulation.recipes import KINDS

PROTOCOL = 3
"""Number of the protocol's implementation: scenes of different numbers are not mixed."""


@dataclass(frozen=True)
class MotionBenchmark:
    """One benchmark. Scene k is of kind k modulo 3: packed, pile, adversarial.

    Attributes:
        robot, camera: names of files in `robot_configs/`.
        config_dir: looked up before the shipped configuration, or None.
        count: objects asked for in a scene.
        candidates: grasps that are labelled in a scene (its positives are the targets).
        reach: targets of a scene whose reachability is tested.
        seeds: random starts of the numerical inverse kinematics, for each flip.
        examined: candidates of one object that a decision looks at.
    """

    robot: str = "panda"
    camera: str = "d435i"
    config_dir: str | None = None
    count: int = 5
    candidates: int = 1500
    reach: int = 5
    seeds: int = 500
    examined: int = 12

    def __post_init__(self) -> None:
        """Refuse counts below one."""
        for name in ("count", "candidates", "reach", "seeds", "examined"):
            if getattr(self, name) < 1:
                raise BadInput(f"{name} is {getattr(self, name)}; ask for at least 1")

    @property
    def _folder(self) -> Path | None:
        """The folder of the configuration."""
        return None if self.config_dir is None else Path(self.config_dir)

    def robot_config(self) -> RobotConfig:
        """The arm.

        Raises:
            BadInput: there is no such file, or it is broken.
        """
        return load_robot(self.robot, self._folder)

    def camera_config(self) -> CameraConfig:
        """The camera.

        Raises:
            BadInput: there is no such file, or it is broken.
        """
        return load_camera(self.camera, self._folder)

    def world_config(self, number: int) -> WorldConfig:
        """The recipe of scene `number`."""
        world = load_world(kind_of(number), self._folder)
        return world.model_copy(update={"count": self.count})

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)

    def digest(self) -> str:
        """Hash of all that determines a scene's row beside its seed and number; the program itself is not in it."""
        models = (self.robot_config(), self.camera_config(), *(self.world_config(k) for k in range(len(KINDS))))
        values = {k: v for k, v in self.to_dict().items() if k != "config_dir"}
        text = json.dumps([PROTOCOL, values, [m.model_dump(mode="json") for m in models]], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def kind_of(number: int) -> str:
    """Kind of scene `number`."""
    return KINDS[number % len(KINDS)]

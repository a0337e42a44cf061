"""How fast a robot may be driven: slowly, until a person has confirmed more for this robot."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import yaml
from pydantic import Field

from evg_app.config.base import Model
from evg_app.config.files import read, search_path

FIRST_SPEED = 0.1
"""Share of the configured speed that a new robot is driven at."""
FOLDER = "calibration"


class SpeedConfirmation(Model):
    """`calibration/<robot>-speed.yaml`, written by `evg-app run --confirm-speed`."""

    robot: str
    speed_share: Annotated[float, Field(gt=0, le=1)]
    confirmed_utc: datetime


def confirmed_speed(robot: str, config_dir: Path | None = None) -> float:
    """The share of the configured speed that a person confirmed for this robot, else `FIRST_SPEED`.

    Raises:
        ConfigError: the file is broken.
    """
    for folder in search_path(config_dir):
        path = folder / FOLDER / f"{robot}-speed.yaml"
        if path.is_file():
            return read(path, SpeedConfirmation).speed_share
    return FIRST_SPEED


def confirm_speed(robot: str, share: float, config_dir: Path | None = None) -> Path:
    """Remember a share for this robot in the user's folder (default: the working directory). Returns the file."""
    folder = (config_dir or Path.cwd()) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{robot}-speed.yaml"
    value = SpeedConfirmation(robot=robot, speed_share=share, confirmed_utc=datetime.now(UTC))
    path.write_text(yaml.safe_dump(value.model_dump(mode="json"), sort_keys=False), encoding="utf-8")
    return path

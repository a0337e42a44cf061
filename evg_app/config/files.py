"""Finding and reading YAML files: the user's folder first, then the working directory, then what is shipped."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError

from evg_app.config.models import CameraConfig, Model, RobotConfig, WorldConfig
from evg_app.errors import BadInput, ConfigError, UnknownName

M = TypeVar("M", bound=Model)

_PACKAGE = Path(__file__).resolve().parent.parent


def shipped_folder() -> Path:
    """Where the shipped `robot_configs/`, `calibration/` and `sim/` are: in the wheel, or the checkout's root."""
    packaged = _PACKAGE / "_data"
    return packaged if packaged.is_dir() else _PACKAGE.parent


def search_path(config_dir: Path | None = None) -> list[Path]:
    """Folders that are searched for config files, first one wins.

    Raises:
        BadInput: `config_dir` is not a folder.
    """
    if config_dir is not None and not config_dir.is_dir():
        raise BadInput(f"--config-dir {config_dir} is not a folder. Give a folder that holds robot_configs/ or sim/.")
    folders = [config_dir, Path.cwd(), shipped_folder()]
    return [folder for folder in folders if folder is not None]


def _named(folders: list[Path], room: str) -> Iterator[tuple[str, Path]]:
    for folder in folders:
        for path in sorted((folder / room).glob("*.yaml")):
            yield path.stem, path


def _is_device(path: Path, kind: str) -> bool:
    """Whether the file says `device: <kind>`; a broken file passes, so that reading it names its fault."""
    declared = re.search(r"^device:\s*(\w+)", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
    return declared is None or declared[1] == kind


def find(kind: str, room: str, name: str, config_dir: Path | None = None) -> Path:
    """Path of `<room>/<name>.yaml` in the search path.

    Raises:
        UnknownName: there is none; the message lists those that exist.
    """
    files: dict[str, Path] = {}
    for stem, path in _named(search_path(config_dir), room):
        if kind == "scene" or _is_device(path, kind):
            files.setdefault(stem, path)
    if name not in files:
        raise UnknownName(kind, name, list(files), f"Put {room}/{name}.yaml into your --config-dir to add one.")
    return files[name]


def _line_of(node: yaml.Node | None, location: tuple[int | str, ...]) -> int | None:
    """1-based line of the deepest part of `location` that exists in the document."""
    line = None
    for part in location:
        if isinstance(node, yaml.MappingNode):
            pairs = [(k, v) for k, v in node.value if getattr(k, "value", None) == str(part)]
            if not pairs:
                break
            key, node = pairs[0]
            line = key.start_mark.line + 1
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
        else:
            break
    return line


def _parse(path: Path) -> tuple[Any, yaml.Node | None]:
    try:
        text = path.read_text(encoding="utf-8")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        return yaml.safe_load(text), node
    except OSError as error:
        raise ConfigError(str(path), None, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), None, "is not UTF-8 text") from error
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise ConfigError(str(path), line, f"is not valid YAML: {error.problem}") from error


def read(path: Path, model: type[M]) -> M:
    """Read one YAML file into its model.

    Raises:
        ConfigError: with file and line: unreadable, not YAML, an unknown key, or a value the model refuses.
    """
    data, node = _parse(path)
    if not isinstance(data, dict):
        raise ConfigError(str(path), 1, "must be a mapping of keys to values")
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        location = first["loc"]
        key = ".".join(str(part) for part in location)
        if first["type"] == "extra_forbidden":
            known = ", ".join(_known_keys(model, location))
            problem = f"unknown key '{key}'; known here: {known}"
        elif first["type"] == "missing":
            problem = f"key '{key}' is missing"
        else:
            problem = f"{key + ': ' if key else ''}{first['msg']}"
        raise ConfigError(str(path), _line_of(node, location), problem) from error


def _known_keys(model: type[Model], location: tuple[int | str, ...]) -> list[str]:
    current: Any = model
    for part in location[:-1]:
        field = getattr(current, "model_fields", {}).get(part)
        if field is None:
            return []
        current = field.annotation
    return sorted(getattr(current, "model_fields", {}))


def load_robot(name: str, config_dir: Path | None = None) -> RobotConfig:
    """The robot config of that name."""
    return read(find("robot", "robot_configs", name, config_dir), RobotConfig)


def load_camera(name: str, config_dir: Path | None = None) -> CameraConfig:
    """The camera config of that name."""
    return read(find("camera", "robot_configs", name, config_dir), CameraConfig)


def load_world(name: str, config_dir: Path | None = None) -> WorldConfig:
    """The simulated scene of that name."""
    return read(find("scene", "sim/worlds", name, config_dir), WorldConfig)

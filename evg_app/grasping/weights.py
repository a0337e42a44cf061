"""Weights files: safetensors plus a JSON card that says what they are; nothing is unpickled."""

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from torch import nn

from evg_app.errors import UnknownName, WeightsError
from evg_app.nets.registry import NAMES, build

WEIGHTS_DIR = Path(__file__).resolve().parent.parent / "weights"
"""Where the shipped weights lie."""
SUFFIX = ".safetensors"


@dataclass(frozen=True)
class WeightsCard:
    """What a weights file is (its `.json` neighbour).

    Attributes:
        name: of the file, without suffix.
        architecture: network it fits, one of `nets.registry.NAMES`.
        config: the network's config, as its `to_dict`.
        sha256: of the safetensors file.
        parameters: free numbers.
        training: data, steps, seeds, losses.
        metrics: what was measured, and on what.
        intended_use, limits: in words.
        created: ISO date and time.
        git_commit: of the code that trained it.
    """

    name: str
    architecture: str
    config: dict[str, Any]
    sha256: str
    parameters: int
    training: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    intended_use: str = ""
    limits: str = ""
    created: str = ""
    git_commit: str = ""


def shipped_weights() -> list[str]:
    """Names of the weights that came with the package, ascending."""
    return sorted(path.stem for path in WEIGHTS_DIR.glob(f"*{SUFFIX}"))


def load_weights(name_or_path: str | Path) -> tuple[nn.Module, WeightsCard]:
    """The network with its weights, in eval mode on the cpu, and its card.

    Args:
        name_or_path: a shipped name, or the path of a `.safetensors` file with its card beside it.

    Raises:
        WeightsError: file or card missing, corrupt, changed since the card was written, or not fitting the network.
    """
    path = _find(name_or_path)
    data = _read(path)
    card = _read_card(path.with_suffix(".json"))
    digest = hashlib.sha256(data).hexdigest()
    if digest != card.sha256:
        raise WeightsError(
            f"{path} is corrupt or truncated: sha256 {digest[:16]}..., its card says {card.sha256[:16]}... "
            f"({len(data)} bytes). Restore it: git checkout -- {path.name}, or copy it again"
        )
    try:
        tensors = safetensors.torch.load(data)
    except (safetensors.SafetensorError, ValueError, KeyError) as error:
        raise WeightsError(f"{path} is not a safetensors file: {error}. {_available()}") from error
    return _filled(path, card, tensors), card


def save_weights(folder: Path, net: nn.Module, card: WeightsCard) -> WeightsCard:
    """Write `<card.name>.safetensors` and its card into a folder; hash and parameters of the card are filled in.

    Raises:
        WeightsError: the folder cannot be written.
    """
    state = {key: value.detach().cpu().contiguous() for key, value in net.state_dict().items()}
    data = safetensors.torch.save(state)
    parameters = sum(p.numel() for p in net.parameters())
    card = dataclasses.replace(card, sha256=hashlib.sha256(data).hexdigest(), parameters=parameters)
    path = folder / f"{card.name}{SUFFIX}"
    try:
        path.write_bytes(data)
        path.with_suffix(".json").write_text(json.dumps(dataclasses.asdict(card), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise WeightsError(f"cannot write weights to {path}: {error.strerror}; choose another folder") from error
    return card


def _available() -> str:
    """Which weights exist, as a sentence."""
    return f"Shipped weights: {', '.join(shipped_weights()) or 'none'}; or give the path of a {SUFFIX} file"


def _find(name_or_path: str | Path) -> Path:
    """The file a name or path means.

    Raises:
        WeightsError: there is none.
    """
    text = str(name_or_path)
    is_path = isinstance(name_or_path, Path) or text.endswith(SUFFIX) or "/" in text
    path = Path(text) if is_path else WEIGHTS_DIR / f"{text}{SUFFIX}"
    if path.suffix != SUFFIX:
        raise WeightsError(f"weights '{text}' are not a {SUFFIX} file. {_available()}")
    if not path.is_file():
        raise WeightsError(f"weights '{text}' do not exist{f' at {path}' if not is_path else ''}. {_available()}")
    return path


def _read(path: Path) -> bytes:
    """The file's bytes.

    Raises:
        WeightsError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise WeightsError(f"{path} cannot be read: {error.strerror}. {_available()}") from error


def _read_card(path: Path) -> WeightsCard:
    """The card at a path.

    Raises:
        WeightsError: it is missing or not a card.
    """
    if not path.is_file():
        raise WeightsError(f"{path} is missing: weights need their card beside them. {_available()}")
    try:
        values = json.loads(_read(path))
        card = WeightsCard(**values)
    except (ValueError, TypeError) as error:
        raise WeightsError(f"{path} is not a card of weights: {error}. {_available()}") from error
    if not (isinstance(card.sha256, str) and isinstance(card.config, dict) and isinstance(card.training, dict)):
        raise WeightsError(f"{path} is not a card of weights: sha256, config or training has the wrong type")
    return card


def _filled(path: Path, card: WeightsCard, tensors: dict[str, torch.Tensor]) -> nn.Module:
    """The card's network holding the tensors, in eval mode.

    Raises:
        WeightsError: they do not fit, or are not finite.
    """
    try:
        with torch.inference_mode(False):
            net = build(card.architecture, card.config)
        net.load_state_dict(tensors)
    except UnknownName as error:
        raise WeightsError(f"card of {path}: {error}") from error
    except (ValueError, TypeError) as error:
        raise WeightsError(f"card of {path} describes no {card.architecture}: {error}") from error
    except RuntimeError as error:
        first = "; ".join(line.strip() for line in str(error).splitlines()[:3])
        raise WeightsError(
            f"{path} does not fit the network '{card.architecture}' of its card: {first}. Known: {', '.join(NAMES)}"
        ) from error
    broken = [key for key, value in tensors.items() if value.is_floating_point() and not torch.isfinite(value).all()]
    if broken:
        raise WeightsError(f"{path} holds values that are not finite in {broken[:3]}; train again or restore the file")
    return net.eval()

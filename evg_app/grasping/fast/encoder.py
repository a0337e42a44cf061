"""Encoders: one scene's grid to its planes, on the processor through onnxruntime, elsewhere through torch."""

from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from evg_app.grasping.fast.lift import SparseLift
from evg_app.nets.triplane import JointTriUNet


class Encoder(Protocol):
    """From TSDF values (40, 40, 40) to planes (3, 40, 40, C), as `Features.planes` of one scene."""

    def __call__(self, values: NDArray[np.float32]) -> Tensor:
        """The planes, on the encoder's device."""


class OnnxEncoder:
    """The exported graph in onnxruntime: a third faster than torch's own layers on a processor (docs/latency.md).

    Args:
        backbone: with its weights.
        threads: that share each layer. They sleep while they wait: a busy core does not stall the others.
    """

    def __init__(self, backbone: JointTriUNet, threads: int) -> None:
        import onnxruntime

        from evg_app.grasping.fast.graph import encoder_graph

        self._lift = SparseLift(backbone.lift)
        options: Any = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.add_session_config_entry("session.dynamic_block_base", "4")
        self._session: Any = onnxruntime.InferenceSession(
            encoder_graph(backbone), options, providers=["CPUExecutionProvider"]
        )

    def __call__(self, values: NDArray[np.float32]) -> Tensor:
        """See `Encoder`."""
        lifted = self._lift(values).numpy()
        return torch.from_numpy(self._session.run(None, {"lifted": lifted})[0])


class TorchEncoder:
    """The network's own backbone, for accelerators."""

    def __init__(self, backbone: JointTriUNet, device: torch.device) -> None:
        self._backbone, self._device = backbone, device

    def __call__(self, values: NDArray[np.float32]) -> Tensor:
        """See `Encoder`."""
        grid = torch.from_numpy(values).to(self._device)[None, None]
        with torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True, allow_tf32=False):
            planes: Tensor = self._backbone(grid).planes
        return planes[:, 0].contiguous()


def encoder_of(net: nn.Module, device: torch.device, threads: int) -> Encoder:
    """The fastest encoder for a network's backbone on a device."""
    backbone = net.backbone
    assert isinstance(backbone, JointTriUNet)
    return OnnxEncoder(backbone, threads) if device.type == "cpu" else TorchEncoder(backbone, device)

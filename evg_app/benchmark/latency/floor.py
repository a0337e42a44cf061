"""The arithmetic limit: how many operations the encoder needs, and how many the machine does per second."""

import time
from collections.abc import Callable

import torch
from torch import nn

from evg_app.geometry import GRID_SIZE
from evg_app.nets.c4 import RegularConv2d
from evg_app.nets.lift import LiftAndProject
from evg_app.nets.triplane import JointTriUNet, SideToPlane

MATRIX = 1024
"""Side of the matrices whose product is timed."""
REPEATS = 12
"""Products timed; the fastest counts."""


def machine_gflops() -> float:
    """Billion floating point operations per second of a large float32 matrix product, with torch's threads."""
    a, b = torch.rand(MATRIX, MATRIX), torch.rand(MATRIX, MATRIX)
    fastest = float("inf")
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        torch.mm(a, b)
        fastest = min(fastest, time.perf_counter() - start)
    return 2.0 * MATRIX**3 / fastest / 1e9


def encoder_gflop(backbone: JointTriUNet) -> float:
    """Billion floating point operations of one scene through a backbone: two for each weight of each output."""
    total = 0

    def counting(outputs: Callable[[torch.Tensor], int]) -> Callable[..., None]:
        """A hook that counts a layer's operations at so many outputs."""

        def hook(module: nn.Module, _inputs: object, result: torch.Tensor) -> None:
            """Hears what the layer gave out."""
            nonlocal total
            total += 2 * _weights(module) * outputs(result)

        return hook

    hooks = []
    for module in backbone.modules():
        if isinstance(module, RegularConv2d | nn.Conv2d | nn.ConvTranspose2d | SideToPlane):
            hooks.append(module.register_forward_hook(counting(lambda out: out.shape[0] * out[0, 0].numel())))
        elif isinstance(module, LiftAndProject):
            hooks.append(module.register_forward_hook(counting(lambda _: GRID_SIZE**3)))
    try:
        with torch.inference_mode():
            backbone(torch.zeros((1, 1, *(GRID_SIZE,) * 3)))
    finally:
        for hook in hooks:
            hook.remove()
    return total / 1e9


def _weights(module: nn.Module) -> int:
    """Weights that meet at one position of the output."""
    if isinstance(module, nn.ConvTranspose2d):  # a window of 2 with stride 2: one weight a channel pair
        return module.in_channels * module.out_channels
    if isinstance(module, nn.Conv2d):
        return module.weight.numel()
    if isinstance(module, SideToPlane):  # only the regular part is applied on the plane
        return module.regular**2
    assert isinstance(module, RegularConv2d | LiftAndProject)
    return module.filter.expand().numel()

"""The rotation flow's Euler steps, without what does not change from step to step."""

import torch
from torch import Tensor, nn

from evg_app.grasping.fast.layers import Affine, Buffers, Trunk
from evg_app.nets.c4 import C4Linear
from evg_app.nets.flow import RotationFlow

_TO_ROWS = [0, 2, 4, 1, 3, 5]
"""Where the numbers of row order stand in the order of irreps (`nets.rotation`)."""


class FlowSampler:
    """Samples `RotationFlow` after an affine map of what it is given."""

    def __init__(self, flow: RotationFlow, before: Affine, device: torch.device) -> None:
        self._context = before.then(Affine.of(flow.context)).final(device)
        out, start = Affine.of(flow.out), Affine.of(flow.start)
        last = Affine(out.weight[:, _TO_ROWS], out.bias[_TO_ROWS])
        self._trunk = Trunk(flow.trunk, last, "flow", device)
        self._inject = [inject.final(device) for inject in self._trunk.inject]
        self._start = Affine(start.weight[_TO_ROWS], start.bias).final(device)
        self._time, self._device = flow.time, device
        self._by_time = [_matrix(layer) for layer in flow.inject_time]
        self._additions: dict[int, Tensor] = {}

    def sample(self, x: Tensor, noise: Tensor, steps: int, buffers: Buffers) -> Tensor:
        """Six numbers in row order (S, N, 6) from noise (S, N, 6) and the points' rows x (N, inputs)."""
        width, (samples, points, _) = self._trunk.width, noise.shape
        context = self._context(x, buffers.take("flow.context", points, width)).relu_()
        prepared = buffers.take("flow.prepared", len(self._inject), points, width)
        for i, inject in enumerate(self._inject):
            inject(context, prepared[i])
        rows = noise.flatten(0, 1).clone()
        net = buffers.take("flow.net", len(rows), width)
        for change in self._times(steps):
            prepared.add_(change)
            self._start(rows, net)
            for i in range(len(self._inject)):
                net.view(samples, points, width).add_(prepared[i])
                self._trunk.block(i, net, buffers)
            rows.add_(self._trunk.last(net), alpha=1.0 / steps)
        return rows.view(noise.shape)

    def _times(self, steps: int) -> Tensor:
        """How what the time adds to each block changes before each step. (steps, blocks, 1, width)."""
        if steps not in self._additions:
            code = self._time(torch.arange(steps, device=self._device) / steps).detach().double().cpu()
            added = torch.stack([code @ matrix for matrix in self._by_time], 1)[:, :, None]
            added[1:] -= added[:-1].clone()
            self._additions[steps] = added.to(self._device, torch.float32)
        return self._additions[steps]


def _matrix(layer: nn.Module) -> Tensor:
    """Of a layer without bias."""
    assert isinstance(layer, C4Linear)
    return Affine.of(layer).weight

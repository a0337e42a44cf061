"""Moving average of a network's weights: what is measured and shipped."""

import torch
from torch import Tensor, nn


class WeightAverage:
    """Exponential moving average of all parameters; `state` is a state dict like the network's."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.decay, self.count = decay, 0
        self.state: dict[str, Tensor] = {k: v.detach().clone() for k, v in model.state_dict().items()}

    @torch.no_grad()
    def update(self, model: nn.Module) -> None:
        """Take in the network's weights after a step; early on the average follows faster."""
        self.count += 1
        keep = min(self.decay, (1 + self.count) / (10 + self.count))
        own, new = [], []
        for key, value in model.state_dict().items():
            if value.is_floating_point():
                own.append(self.state[key])
                new.append(value)
            else:
                self.state[key].copy_(value)
        torch._foreach_lerp_(own, new, 1.0 - keep)

"""The encoder as an ONNX graph with expanded filters, made in memory from any weights (no tracing, no file)."""

import numpy as np
import torch
from torch import Tensor, nn

from evg_app.geometry import GRID_SIZE
from evg_app.grasping.fast.graph import Graph
from evg_app.nets.c4 import RegularConv2d
from evg_app.nets.fibres import ORDER
from evg_app.nets.triplane import JointTriUNet, PlainBlock, SideToPlane, SteerableBlock


def encoder_graph(backbone: JointTriUNet) -> bytes:
    """The backbone from lifted planes ("lifted", see `lift`) to `Features.planes` of one scene ("planes").

    Both have the shape (3, 40, 40, C).
    """
    shape = [3, GRID_SIZE, GRID_SIZE, ORDER * backbone.reg[0]]
    writer = _Writer(backbone)
    result = writer.planes("lifted")
    return writer.graph.model({"lifted": shape}, {"planes": (result, shape)})


class _Writer:
    """Walks through the backbone as its `forward` does."""

    def __init__(self, backbone: JointTriUNet) -> None:
        self.net, self.graph = backbone, Graph()
        self.exact = backbone.side == "exact"
        self.views = ORDER if self.exact else 2

    def planes(self, lifted: str) -> str:
        """The three output planes, channels last."""
        g, net = self.graph, self.net
        xy, views = self._views(lifted)
        skips: list[tuple[str, str]] = []
        for level in range(len(net.reg)):
            if level:
                xy = g.add("AveragePool", xy, kernel_shape=[2, 2], strides=[2, 2])
                views = g.add("MaxPool", views, kernel_shape=[2, 2], strides=[2, 2])
            xy, views = self._steer(xy, net.xy_down[level]), self._plain(views, net.side_down[level])
            xy = self._join(xy, views, net.s2tp_down[level], GRID_SIZE >> level)
            skips.append((xy, views))
        skips.pop()
        for i, join in enumerate(net.s2tp_up):
            xy_skip, views_skip = skips.pop()
            xy = self._steer(self._up(xy, net.xy_up[i]), net.xy_merge[i], xy_skip)
            views = self._plain(self._transposed(views, net.side_up[i]), net.side_merge[i], views_skip)
            xy = self._join(xy, views, join, GRID_SIZE >> len(skips))
        out = net.side_out
        assert isinstance(out, nn.Conv2d) and out.bias is not None
        sides = g.conv(self._fold(views), self._share() * out.weight, out.bias)
        joined = g.add("Concat", self._regular(xy, net.xy_out), sides, axis=0)
        return g.add("Transpose", joined, perm=[0, 2, 3, 1])

    def _views(self, lifted: str) -> tuple[str, str]:
        """Plane xy (1, C, X, Y) and the side views (V, C, horizontal, Z) of lifted planes (3, 40, 40, C)."""
        g = self.graph
        first = g.add("Transpose", lifted, perm=[0, 3, 1, 2])
        xy = g.add("Slice", first, g.constant([0]), g.constant([1]), g.constant([0]))
        if not self.exact:
            return xy, g.add("Slice", first, g.constant([1]), g.constant([3]), g.constant([0]))
        xz, yz = (g.add("Gather", first, g.constant(np.array(k)), axis=0) for k in (1, 2))
        seen = [xz, yz, self._flip(xz, 1), self._flip(yz, 1)]
        return xy, self._stack([self._roll(v, -k) for k, v in enumerate(seen)])

    def _stack(self, views: list[str]) -> str:
        """Views (C, ...) as a batch (V, C, ...)."""
        g = self.graph
        return g.add("Concat", *[g.add("Unsqueeze", v, g.constant([0])) for v in views], axis=0)

    def _flip(self, x: str, axis: int) -> str:
        """Reversed along an axis."""
        g = self.graph
        return g.add("Slice", x, g.constant([-1]), g.constant([-1000]), g.constant([axis]), g.constant([-1]))

    def _roll(self, x: str, shift: int) -> str:
        """Channels (C, ...) with the four orientations of every copy rolled."""
        if shift % ORDER == 0:
            return x
        index = np.arange(ORDER * self.net.reg[0]).reshape(-1, ORDER)
        return self.graph.add("Gather", x, self.graph.constant(np.roll(index, shift, 1).ravel()), axis=0)

    def _regular(self, x: str, layer: nn.Module, relu: bool = False, skip: str | None = None) -> str:
        """A layer of x, or of x and a skip connection side by side."""
        assert isinstance(layer, RegularConv2d)
        return self._conv(x, layer.filter.expand(), layer.bias.expand(), relu, skip)

    def _conv(self, x: str, weight: Tensor, bias: Tensor, relu: bool, skip: str | None) -> str:
        """A convolution of x and a skip connection side by side, as a sum: nothing has to be put side by side."""
        if skip is None:
            return self.graph.conv(x, weight, bias, relu)
        own = weight.shape[1] // 2
        both = self.graph.conv(x, weight[:, :own], bias), self.graph.conv(skip, weight[:, own:], None)
        total = self.graph.add("Add", *both)
        return self.graph.add("Relu", total) if relu else total

    def _steer(self, x: str, block: nn.Module, skip: str | None = None) -> str:
        """A `SteerableBlock` of x, or of x and a skip connection side by side."""
        assert isinstance(block, SteerableBlock)
        r = self._regular(x, block.first, relu=True, skip=skip)
        out = self._regular(self._regular(r, block.second, relu=True), block.third)
        return self.graph.add("Relu", self.graph.add("Add", out, r))

    def _plain(self, x: str, block: nn.Module, skip: str | None = None) -> str:
        """A `PlainBlock` of x, or of x and a skip connection side by side."""
        assert isinstance(block, PlainBlock)
        for conv, beside in ((block.first, skip), (block.second, None)):
            assert isinstance(conv, nn.Conv2d) and conv.bias is not None
            x = self._conv(x, conv.weight, conv.bias, True, beside)
        return x

    def _up(self, x: str, layer: nn.Module) -> str:
        """Twice the size, bilinear, and a convolution."""
        g = self.graph
        scales = g.constant(np.array([1, 1, 2, 2], dtype=np.float32))
        big = g.add("Resize", x, "", scales, mode="linear", coordinate_transformation_mode="half_pixel")
        return self._regular(big, layer)

    def _transposed(self, x: str, layer: nn.Module) -> str:
        """Twice the size, by a transposed convolution."""
        assert isinstance(layer, nn.ConvTranspose2d) and layer.bias is not None
        g = self.graph
        weight, bias = g.constant(layer.weight), g.constant(layer.bias)
        return g.add("ConvTranspose", x, weight, bias, strides=[2, 2])

    def _join(self, xy: str, views: str, join: nn.Module, size: int) -> str:
        """S2TP at a level of `size` pixels a side: what the views say of a pixel is one product of all their means."""
        assert isinstance(join, SideToPlane)
        g, matrix = self.graph, join.linear.matrix.expand()
        regular, invariant = matrix[:, : join.regular], matrix[:, join.regular :]
        out = g.conv(xy, regular[..., None, None], join.bias.expand())
        means = g.add("AveragePool", views, kernel_shape=[1, size])  # (V, C, horizontal, 1)
        flat = g.add("Reshape", g.add("Transpose", means, perm=[3, 1, 0, 2]), g.constant([-1, self.views * size]))
        seen = g.add("Reshape", g.add("MatMul", flat, g.constant(self._spread(size))), g.constant([1, -1, size, size]))
        return g.add("Add", out, g.conv(seen, invariant[..., None, None], None))

    def _spread(self, size: int) -> Tensor:
        """From all views' values along their horizontal axis to pixels (x, y), see `JointTriUNet._fold`."""
        along = torch.eye(size)
        x, y = along[:, :, None].expand(-1, -1, size), along[:, None, :].expand(-1, size, -1)
        each = [x, y, x.flip(0), y.flip(0)] if self.exact else [x, y]
        return self._share() * torch.cat([one.flatten(1) for one in each])

    def _share(self) -> float:
        """Of a view in its fold."""
        return 0.5 if self.exact else 1.0

    def _fold(self, views: str) -> str:
        """`JointTriUNet._fold` of views (V, C, horizontal, Z), without its factor: (2, C, horizontal, Z)."""
        if not self.exact:
            return views
        g = self.graph
        first = g.add("Slice", views, g.constant([0]), g.constant([2]), g.constant([0]))
        behind = g.add(
            "Slice", views, g.constant([2, -1]), g.constant([4, -1000]), g.constant([0, 2]), g.constant([1, -1])
        )
        return g.add("Add", first, behind)

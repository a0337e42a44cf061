"""ONNX graphs made in memory: a little writer, and the session that runs one on the calling thread."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor

from evg_app.grasping.fast.affine import Affine

OPSET = 17
"""Of ONNX: old enough for every runtime of the last years."""
Shape = Sequence[int | str]
"""Lengths of axes; a name for any length."""


class Graph:
    """Collects nodes and constants; every method adds one operation and returns the name of its result."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, values: NDArray[Any] | Tensor | list[int]) -> str:
        """A constant array (lists are int64, tensors float32)."""
        name = f"c{len(self.constants)}"
        if isinstance(values, Tensor):
            values = values.detach().float().numpy()
        array = np.array(values, dtype=np.int64 if isinstance(values, list) else None, order="C")
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operation: str, *inputs: str, **attributes: Any) -> str:
        """Any operation with one result."""
        name = f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(operation, list(inputs), [name], **attributes))
        return name

    def affine(self, x: str, layer: Affine, relu: bool = False) -> str:
        """The map of rows x, and maybe a ReLU."""
        out = self.add("Gemm", x, self.constant(layer.weight), self.constant(layer.bias))
        return self.add("Relu", out) if relu else out

    def conv(self, x: str, weight: Tensor, bias: Tensor | None, relu: bool = False) -> str:
        """A convolution that keeps the size, and maybe a ReLU."""
        arrays = [self.constant(weight)] + ([] if bias is None else [self.constant(bias)])
        pad = weight.shape[-1] // 2
        out = self.add("Conv", x, *arrays, pads=[pad] * 4)
        return self.add("Relu", out) if relu else out

    def model(self, inputs: Mapping[str, Shape], results: Mapping[str, tuple[str, Shape]]) -> bytes:
        """The finished model, serialised. `results` say which value is given out under a name, and its shape.

        A value whose name begins with "index" or "rows" is int32, all others are float32.
        """
        for name, (result, _) in results.items():
            self.nodes.append(helper.make_node("Identity", [result], [name]))
        outputs = {name: shape for name, (_, shape) in results.items()}
        values = [
            [
                helper.make_tensor_value_info(
                    name, TensorProto.INT32 if name.startswith(("index", "rows")) else TensorProto.FLOAT, list(shape)
                )
                for name, shape in side.items()
            ]
            for side in (inputs, outputs)
        ]
        graph = helper.make_graph(self.nodes, "evg", values[0], values[1], self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
        data: bytes = model.SerializeToString()
        return data


class Native:
    """A graph in onnxruntime, on the processor. One call runs all of it without Python's lock: threads do not wait.

    Args:
        model: serialised.
        threads: that share each operation. They sleep while they wait: a busy core does not stall the others.
    """

    def __init__(self, model: bytes, threads: int = 1) -> None:
        import onnxruntime

        options: Any = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.add_session_config_entry("session.dynamic_block_base", "4")
        self._session: Any = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        self._inputs = [value.name for value in self._session.get_inputs()]

    def __call__(self, *inputs: Tensor) -> list[Tensor]:
        """The results, in order, for the inputs, in order."""
        feeds = {name: x.numpy() for name, x in zip(self._inputs, inputs, strict=True)}
        return [torch.from_numpy(result) for result in self._session.run(None, feeds)]

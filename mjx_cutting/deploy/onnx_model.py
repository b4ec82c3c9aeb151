"""An exported policy as an ONNX model: opset 17, self-describing, the same golden pairs inside.

One input, `observation` [batch, observation] in physical units, and two outputs, `action` [batch, action] in
[-1, 1] and `set_point` [batch, action] in the actions' units; the equation is that of artefact.py. The
description stands in the model's metadata_props as JSON: `header` (all of the npz file's header, with its
SHA-256), `golden_observation` and `golden_action`. The graph is written node by node with onnx.helper, so
nothing depends on a converter. Needs the extra `export`.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import ModuleType
from typing import Any

from mjx_cutting._files import write_atomic
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.runtime import TOLERANCE, Verification

# isort: split
import numpy as np

OPSET = 17
IR_VERSION = 9


def write_onnx(artefact: Artefact, path: str | os.PathLike[str]) -> Path:
    """Returns `path`, written atomically: the artefact as an ONNX model that passed onnx's own checker.

    Raises:
        ValueError: the package onnx is not installed.
        OSError: the file cannot be written.
    """
    onnx = _import("onnx")
    model = _model(artefact, onnx)
    onnx.checker.check_model(model, full_check=True)
    return write_atomic(path, model.SerializeToString())


def verify_onnx(path: str | os.PathLike[str]) -> Verification:
    """Returns how far onnxruntime's actions on this machine lie from the golden ones in the file.

    Raises:
        ValueError: onnxruntime is not installed, or the file is no policy exported by this package.
    """
    runtime = _import("onnxruntime")
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"got no file at {path}; expected an exported ONNX policy; check the path")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    try:
        session = runtime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
        told = session.get_modelmeta().custom_metadata_map
        observations = np.asarray(json.loads(told["golden_observation"]), np.float32)
        golden = np.asarray(json.loads(told["golden_action"]), np.float32)
        digest = json.loads(told["header"])["sha256"]
        (actions,) = session.run(["action"], {"observation": observations})
    except _errors(runtime) as error:
        raise ValueError(
            f"got a file {path} that is no exported ONNX policy ({type(error).__name__}: {error}); "
            "export it again: mjx-cutting export RUN --format onnx"
        ) from error
    worst = float(np.max(np.abs(actions - golden))) / 2.0
    return Verification(len(golden), worst, digest, worst <= TOLERANCE)


def _model(artefact: Artefact, onnx: ModuleType) -> Any:
    graph = _Graph(onnx)
    x = graph.add("Div", "observation", graph.constant("scale", artefact.observation_scales))
    x = graph.add("Sub", x, graph.constant("mean", artefact.mean))
    x = graph.add("Div", x, graph.constant("std", artefact.std))
    x = graph.add(
        "Clip", x, graph.constant("clip_low", -artefact.clip), graph.constant("clip_high", artefact.clip)
    )
    for i, (weights, bias) in enumerate(artefact.layers):
        x = graph.add("Gemm", x, graph.constant(f"weights_{i}", weights), graph.constant(f"bias_{i}", bias))
        if i < len(artefact.layers) - 1:
            x = _activated(graph, x, artefact.activation)
    action = graph.add("Tanh", x, output="action")
    _set_point(graph, artefact, action)
    helper, floats = onnx.helper, onnx.TensorProto.FLOAT
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "mjx_cutting_policy",
            [helper.make_tensor_value_info("observation", floats, ["batch", artefact.observation_size])],
            [
                helper.make_tensor_value_info(name, floats, ["batch", artefact.action_size])
                for name in ("action", "set_point")
            ],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="mjx-cutting",
    )
    helper.set_model_props(
        model,
        {
            "header": json.dumps({**artefact.header(), "sha256": artefact.sha256}),
            "golden_observation": json.dumps(artefact.golden_observation.tolist()),
            "golden_action": json.dumps(artefact.golden_action.tolist()),
        },
    )
    return model


def _activated(graph: _Graph, x: str, activation: str) -> str:
    if activation == "swish":
        return graph.add("Mul", x, graph.add("Sigmoid", x))
    return graph.add({"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}[activation], x)


def _set_point(graph: _Graph, artefact: Artefact, action: str) -> None:
    """low + (a + 1)/2 (high - low), in the logarithm where the artefact says so."""
    low, high, log = (
        np.asarray(x, np.float64) for x in (artefact.action_low, artefact.action_high, artefact.action_log)
    )
    ratio = np.where(log > 0, high / np.where(low > 0, low, 1.0), 1.0)
    share = graph.add(
        "Mul", graph.add("Add", action, graph.constant("one", [1.0])), graph.constant("half", [0.5])
    )
    linear = graph.add(
        "Add",
        graph.constant("linear_low", low),
        graph.add("Mul", share, graph.constant("linear_span", np.where(log > 0, 0.0, high - low))),
    )
    # for a log action `linear` is low, and low (high / low)^share is the set-point
    growth = graph.add("Exp", graph.add("Mul", share, graph.constant("log_span", np.log(ratio))))
    graph.add("Mul", linear, growth, output="set_point")


class _Graph:
    """Nodes and constants as they are added; `add` returns the name of a node's output."""

    def __init__(self, onnx: ModuleType):
        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, name: str, value: Any) -> str:
        self.constants.append(self._onnx.numpy_helper.from_array(np.asarray(value, np.float32), name))
        return name

    def add(self, kind: str, *inputs: str, output: str | None = None) -> str:
        name = output or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, list(inputs), [name], name=name))
        return name


def _errors(runtime: ModuleType) -> tuple[type[Exception], ...]:
    """What a foreign file raises: onnxruntime has kinds of its own, without a common base but Exception."""
    state = vars(runtime.capi.onnxruntime_pybind11_state).values()
    own = (kind for kind in state if isinstance(kind, type) and issubclass(kind, Exception))
    return (KeyError, TypeError, ValueError, *own)


def _import(name: str) -> ModuleType:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ValueError(
            f"got no package {name}, which ONNX policies need; install it: pip install 'mjx-cutting[export]'"
        ) from error

"""Checks that the state dicts of a checkpoint can be loaded into an agent's modules."""

from collections.abc import Mapping
from typing import Any

import torch


def check_modules(states: Mapping[str, Any], modules: Mapping[str, Any]) -> None:
    """Checks state dicts by the modules that they are for.

    Args:
      states: state dicts by name.
      modules: networks, scalers and an optimiser, by name.

    Raises:
      ValueError: a name, a shape or a type differs.
    """
    if states.keys() != modules.keys():
        raise ValueError(f"the modules must be {[*modules]}, got {[*states]}")
    for name, module in modules.items():
        if isinstance(module, torch.optim.Optimizer):
            _check_optimizer(states[name], module)
        else:
            _check_tensors(states[name], module.state_dict(), name)


def _check_optimizer(state: Any, optimizer: torch.optim.Optimizer) -> None:
    """Checks the state dict of an Adam optimiser, which has moments for each parameter that has had a gradient."""
    if not isinstance(state, Mapping) or not isinstance(state.get("state"), Mapping):
        raise ValueError("the optimizer has no state")
    for group, expected in zip(state["param_groups"], optimizer.state_dict()["param_groups"], strict=True):
        if not isinstance(group["lr"], float | int) or group["params"] != expected["params"]:
            raise ValueError("the optimizer is one of other parameters")
        if odd := [name for name, value in group.items() if name != "lr" and value != expected.get(name, value)]:
            raise ValueError(f"the optimizer has other {odd}")
    parameters = [parameter.detach() for group in optimizer.param_groups for parameter in group["params"]]
    templates = {
        i: {"step": torch.tensor(0.0), "exp_avg": parameter, "exp_avg_sq": parameter}
        for i, parameter in enumerate(parameters)
    }
    for i, moments in state["state"].items():
        if i not in templates:
            raise ValueError(f"the optimizer has no parameter {i!r}")
        _check_tensors(moments, templates[i], f"optimizer[{i}]")


def _check_tensors(tensors: Any, expected: Mapping[str, torch.Tensor], name: str) -> None:
    """Checks a dict of tensors by their names, shapes and dtypes."""
    if not isinstance(tensors, Mapping) or tensors.keys() != expected.keys():
        raise ValueError(f"{name} must have the tensors {[*expected]}")
    for key, template in expected.items():
        tensor = tensors[key]
        if not isinstance(tensor, torch.Tensor) or (tensor.shape, tensor.dtype) != (template.shape, template.dtype):
            raise ValueError(f"{name}[{key!r}] must be {template.dtype} of shape {tuple(template.shape)}")

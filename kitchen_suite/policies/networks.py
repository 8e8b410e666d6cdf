"""Networks that act with numpy alone; PyTorch's arrays of the same names are in `training.bc`."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

CLIP = 10.0  # Bound of standardised inputs.


class Linear(NamedTuple):
    """An affine map with weight `(n, m)` and bias `(n,)`."""

    weight: NDArray[np.float32]
    bias: NDArray[np.float32]

    def __call__(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns `(..., n)` for values `(..., m)`."""
        return values @ self.weight.T + self.bias


class Block(NamedTuple):
    """A residual block: normalisation of the layer, and two affine maps with SiLU units between them.

    Attributes:
      norm: scale `(w,)` and shift `(w,)` of the normalised values.
      first: from `w` values to `w`.
      second: from `w` values to `w`.
    """

    norm: Linear
    first: Linear
    second: Linear

    def __call__(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns `(..., w)` for values `(..., w)`."""
        centred = values - values.mean(axis=-1, keepdims=True)
        variance = np.square(centred).mean(axis=-1, keepdims=True)
        # With the epsilon of PyTorch.
        normalised = centred / np.sqrt(variance + np.float32(1e-5)) * self.norm.weight + self.norm.bias
        return values + self.second(silu(self.first(normalised)))


class ResidualNetwork(NamedTuple):
    """An affine map, residual blocks, and another affine map.

    Attributes:
      input: from `m` values to `w`.
      blocks: from `w` values to `w`.
      output: from `w` values to `n`.
    """

    input: Linear
    blocks: tuple[Block, ...]
    output: Linear

    @classmethod
    def take(cls, arrays: dict[str, NDArray], name: str) -> Self:
        """Removes the arrays of a network, such as `<name>.blocks.0.first.weight`, from others; returns the network.

        Raises a ValueError if an array is missing or unknown, or does not fit the others.
        """
        count = sum(key.startswith(f"{name}.") and key.endswith(".norm.weight") for key in arrays)
        parts = ["input", *(f"blocks.{i}.{part}" for i in range(count) for part in Block._fields), "output"]
        first, *middle, last = _take_parts(arrays, name, parts)
        width = first.bias.size
        size = len(Block._fields)
        square = (width, width)
        expected = [(width, *first.weight.shape[-1:]), *[(width,), square, square] * count, (last.bias.size, width)]
        for label, (weight, bias), shape in zip(parts, (first, *middle, last), expected, strict=True):
            if weight.shape != shape or bias.shape != shape[:1]:
                raise ValueError(f"{name}.{label} has parts of shapes {weight.shape} and {bias.shape}, not {shape}")
        return cls(first, tuple(Block(*middle[i : i + size]) for i in range(0, len(middle), size)), last)

    @property
    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Its arrays by name, such as `blocks.0.first.weight`."""
        parts = {"input": self.input, "output": self.output}
        for i, block in enumerate(self.blocks):
            parts |= {f"blocks.{i}.{name}": part for name, part in block._asdict().items()}
        return _named(parts)

    @property
    def inputs(self) -> int:
        """Number of values that the network takes."""
        return self.input.weight.shape[-1]

    @property
    def outputs(self) -> int:
        """Number of values that it returns."""
        return self.output.bias.size

    def __call__(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns `(..., n)` for values `(..., m)`."""
        values = self.input(values)
        for block in self.blocks:
            values = block(values)
        return self.output(values)


class Convolution(NamedTuple):
    """A convolution that halves height and width, with rectified outputs.

    Its weight is `(n, m, s, s)`, with an odd size `s`, and its bias `(n,)`; zeros surround the values.
    """

    weight: NDArray[np.float32]
    bias: NDArray[np.float32]

    def __call__(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns `(n, (h + 1) // 2, (w + 1) // 2)` for values `(m, h, w)`."""
        count, _, size, _ = self.weight.shape
        margin = (size // 2, size // 2)
        padded = np.pad(values, ((0, 0), margin, margin))
        windows = np.lib.stride_tricks.sliding_window_view(padded, (size, size), axis=(1, 2))[:, ::2, ::2]
        _, height, width, _, _ = windows.shape
        columns = windows.transpose(1, 2, 0, 3, 4).reshape(height * width, -1)
        outputs = columns @ self.weight.reshape(count, -1).T + self.bias
        return np.maximum(outputs.T.reshape(count, height, width), 0)


class PictureEncoder(NamedTuple):
    """Convolutions, from the three channels of a picture, and an affine map of the last one's outputs to features."""

    convolutions: tuple[Convolution, ...]
    output: Linear

    @classmethod
    def take(cls, arrays: dict[str, NDArray], name: str) -> Self:
        """Removes the arrays of an encoder, such as `<name>.convolutions.0.weight`, from others; returns the encoder.

        Raises a ValueError if an array is missing or unknown, or does not fit the others.
        """
        count = sum(key.startswith(f"{name}.convolutions.") and key.endswith(".weight") for key in arrays)
        *layers, output = _take_parts(arrays, name, [*(f"convolutions.{i}" for i in range(count)), "output"])
        channels = 3
        for weight, bias in layers:
            if weight.ndim != 4 or weight.shape != (bias.size, channels, *weight.shape[2:3] * 2):
                raise ValueError(f"{name} has a convolution of shape {weight.shape} after {channels} channels")
            if bias.ndim != 1 or not weight.shape[2] % 2:
                raise ValueError(f"{name} has a convolution with {bias.shape} biases and a size of {weight.shape[2]}")
            channels = bias.size
        if output.bias.ndim != 1 or output.weight.ndim != 2 or len(output.weight) != output.bias.size:
            raise ValueError(f"{name} has outputs of shapes {output.weight.shape} and {output.bias.shape}")
        return cls(tuple(Convolution(*layer) for layer in layers), output)

    @property
    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Its arrays by name, such as `convolutions.0.weight`."""
        parts: dict[str, Convolution | Linear] = {f"convolutions.{i}": each for i, each in enumerate(self.convolutions)}
        parts["output"] = self.output
        return _named(parts)

    @property
    def features(self) -> int:
        """Number of features."""
        return self.output.bias.size

    def check_takes(self, height: int, width: int) -> None:
        """Raises a ValueError unless pictures of a size [pixels] are what the encoder takes."""
        for _ in self.convolutions:
            height = (height + 1) // 2
            width = (width + 1) // 2
        channels = self.convolutions[-1].bias.size if self.convolutions else 3
        if self.output.weight.shape[1] != channels * height * width:
            raise ValueError("an encoder does not take pictures of this size")

    def __call__(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Returns the features `(n,)` of a picture `(h, w, 3)`."""
        values = picture.transpose(2, 0, 1).astype(np.float32) / np.float32(255) - np.float32(0.5)
        for convolution in self.convolutions:
            values = convolution(values)
        return self.output(values.ravel())


def silu(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns values times their logistic function."""
    result: NDArray[np.float32] = values * expit(values)
    return result


def _named(parts: Mapping[str, Convolution | Linear]) -> dict[str, NDArray[np.float32]]:
    """Returns weight and bias of each part, by name."""
    return {f"{name}.{kind}": array for name, part in parts.items() for kind, array in part._asdict().items()}


def _take_parts(arrays: dict[str, NDArray], name: str, parts: Iterable[str]) -> list[Linear]:
    """Removes the arrays of a network, whose names begin with its own, from others; returns weight and bias by part.

    Raises a ValueError unless these are all of them.
    """
    own = {key: arrays.pop(key) for key in [*arrays] if key.startswith(f"{name}.")}
    names = [[f"{name}.{part}.{kind}" for kind in Linear._fields] for part in parts]
    if odd := sorted(own.keys() ^ {each for pair in names for each in pair}):
        raise ValueError(f"missing or unknown arrays {odd}")
    return [Linear(*(checked(own[each], each) for each in pair)) for pair in names]


def checked(array: NDArray, name: str) -> NDArray[np.float32]:
    """Returns an array; raises a ValueError unless it is of finite numbers of float32."""
    if array.dtype != np.float32 or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers of float32; it is of {array.dtype}")
    return array


class Scales(NamedTuple):
    """Standardisation of inputs and actions.

    Attributes:
      input_mean: `(m,)`.
      input_deviation: `(m,)`, positive.
      action_mean: `(k,)`.
      action_deviation: `(k,)`, positive.
    """

    input_mean: NDArray[np.float32]
    input_deviation: NDArray[np.float32]
    action_mean: NDArray[np.float32]
    action_deviation: NDArray[np.float32]

    @classmethod
    def take(cls, arrays: dict[str, NDArray]) -> Self:
        """Removes the arrays of the scales from others, and returns the scales; raises a ValueError for bad ones."""
        scales = cls(**{name: checked(arrays.pop(name), name) for name in cls._fields if name in arrays})
        pairs = (scales.input_mean, scales.input_deviation), (scales.action_mean, scales.action_deviation)
        for mean, deviation in pairs:
            if mean.ndim != 1 or mean.shape != deviation.shape or not (deviation > 0).all():
                raise ValueError("means and positive deviations must be vectors of the same length")
        return scales

    def inputs(self, inputs: NDArray) -> NDArray[np.float32]:
        """Returns inputs `(..., m)` standardised, and clipped."""
        values = ((inputs - self.input_mean) / self.input_deviation).astype(np.float32)
        return np.clip(values, -CLIP, CLIP)

    def actions(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the actions `(..., k)` whose standardised values are given."""
        return values * self.action_deviation + self.action_mean

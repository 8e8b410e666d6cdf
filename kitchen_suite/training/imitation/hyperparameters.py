"""Hyperparameters of imitation."""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImitationHyperparameters:
    """Hyperparameters of all algorithms of imitation.

    Networks are residual: blocks with normalisation and SiLU units.

    Attributes:
      width: values between the blocks.
      blocks: number of blocks.
      chunk: number of actions that are predicted at once.
      executed: number of these that are applied before the next prediction.
      batch_size: samples of a step of the optimiser.
      learning_rate: of the optimiser (AdamW) at first; it falls to 0 like half a cosine.
      weight_decay: of the optimiser.
      averaging: decay of the moving average of the weights, which is what acts.
      input_noise: standard deviation of normal noise on the inputs in training, in units of their standard deviations.
      standardisation_epsilon: added to the standard deviations that inputs are divided by, in units of the inputs;
        positive.
    """

    width: int = 384
    blocks: int = 3
    chunk: int = 8
    executed: int = 1
    batch_size: int = 512
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    averaging: float = 0.999
    input_noise: float = 0.0
    standardisation_epsilon: float = 0.01


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlowHyperparameters(ImitationHyperparameters):
    """Hyperparameters of flow matching.

    Attributes:
      flow_steps: steps of Euler's method in a prediction.
    """

    executed: int = 4
    flow_steps: int = 8


@dataclasses.dataclass(frozen=True, kw_only=True)
class TokenHyperparameters(ImitationHyperparameters):
    """Hyperparameters of VQ-BeT.

    Attributes:
      codebooks: number of codes of a chunk, the later ones for what the earlier leave over.
      codes: number of codes in each codebook.
      latent: length of a code vector.
      quantizer_steps: steps of the optimiser, the first ones, that fit codes and decoder.
      offset_scale: factor of the error of the predicted chunks, beside the likelihood of the codes.
    """

    codebooks: int = 2
    codes: int = 16
    latent: int = 64
    quantizer_steps: int = 1500
    offset_scale: float = 5.0

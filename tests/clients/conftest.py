"""Settings of the libraries that tests of clients share."""

import pytest


@pytest.fixture(scope="module")
def one_thread():
    """Lets PyTorch compute in one thread."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)

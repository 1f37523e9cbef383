"""The optimizer Muon: steps along orthogonal matrices, one for each kernel."""

import pytest

torch = pytest.importorskip("torch")
muon = pytest.importorskip("pnp_sci.training.muon")


@pytest.mark.parametrize("shape", [(3, 16, 16), (2, 8, 72), (1, 64, 20)])
def test_steps_are_orthogonal(shape):
    """Singular values near 1, and the singular vectors of the matrix itself."""
    matrices = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    found = muon.orthogonal(matrices)
    values = torch.linalg.svdvals(found)
    assert 0.4 < values.median() < 1.3
    assert values.max() < 1.35
    left, _, right = torch.linalg.svd(matrices, full_matrices=False)
    mixed = left.mT @ found @ right.mT
    assert torch.linalg.matrix_norm(mixed - torch.diag_embed(mixed.diagonal(dim1=1, dim2=2))).max() < 0.15


def test_every_kernel_moves_by_its_rate():
    """Whatever the size of the gradient and of the kernel, the step is as long as Adam's is."""
    kernels = [torch.nn.Parameter(torch.zeros(shape)) for shape in ((8, 8, 3, 3), (8, 8, 3, 3), (16, 4, 1, 1))]
    for size, kernel in zip((1e-6, 1, 1e3), kernels):
        kernel.grad = size * torch.randn(kernel.shape, generator=torch.Generator().manual_seed(0))
    muon.Muon(kernels, 0.01, 0).step()
    for kernel in kernels:
        assert (kernel * kernel.grad).sum() < 0, "downhill"
        assert kernel.square().mean().sqrt().item() == pytest.approx(0.2 * 0.01, rel=0.4)


def test_kernels_move_together_as_each_alone():
    """With momentum and decay over three steps, and wherever their channels lie in memory."""
    random = torch.Generator().manual_seed(0)
    starts, *gradients = torch.randn(4, 2, 8, 16, 3, 3, generator=random)
    together = [torch.nn.Parameter(k.contiguous(memory_format=torch.channels_last)) for k in starts]
    alone = [torch.nn.Parameter(k.clone()) for k in starts]
    optimizers = [muon.Muon(together, 0.01, 0.1), *(muon.Muon([k], 0.01, 0.1) for k in alone)]
    for pair in gradients:
        for k, gradient in enumerate(pair):
            together[k].grad, alone[k].grad = gradient.clone(memory_format=torch.channels_last), gradient
        for optimizer in optimizers:
            optimizer.step()
    for one, other in zip(together, alone):
        torch.testing.assert_close(one, other, atol=1e-3, rtol=0)
    assert not torch.allclose(together[0], starts[0], atol=1e-2)

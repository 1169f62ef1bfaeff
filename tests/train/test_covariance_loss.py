import pytest
import torch

from sips_lit.detect.covariance import covariance_matrices
from sips_lit.train.covariance_loss import gaussian_nll, residual_covariances

TRUTH = torch.tensor([[1.44, 0.3], [0.3, 0.25]])  # x varies more than y


def residuals(count: int, covariance: torch.Tensor = TRUTH) -> torch.Tensor:
    noise = torch.randn(count, 2, generator=torch.Generator().manual_seed(0))
    return noise @ torch.linalg.cholesky(covariance).T


def fitted(residual: torch.Tensor) -> torch.Tensor:
    """The covariance, of three numbers, that the loss likes best for all residuals."""
    numbers = torch.zeros(1, 3, requires_grad=True)
    optimizer = torch.optim.LBFGS([numbers], max_iter=50, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        loss = gaussian_nll(residual, covariance_matrices(numbers).expand(len(residual), 2, 2)).mean()
        loss.backward()
        return loss

    optimizer.step(closure)
    return covariance_matrices(numbers.detach())[0]


def test_a_known_covariance_is_found_again():
    found = fitted(residuals(20_000))
    torch.testing.assert_close(found, TRUTH, rtol=0.03, atol=0.01)


def test_swapped_axes_are_noticed():
    swapped = fitted(residuals(20_000).flip(1))
    torch.testing.assert_close(swapped, TRUTH.flip(0, 1), rtol=0.03, atol=0.01)
    assert not torch.allclose(swapped, TRUTH, rtol=0.3)


def test_it_is_the_normal_density_of_torch():
    generator = torch.Generator().manual_seed(1)
    covariance = covariance_matrices(torch.randn(50, 3, generator=generator)).double()
    residual = torch.randn(50, 2, generator=generator).double()
    density = torch.distributions.MultivariateNormal(torch.zeros(50, 2).double(), covariance).log_prob(residual)
    torch.testing.assert_close(
        gaussian_nll(residual, covariance), -density - torch.log(torch.tensor(2 * torch.pi)).double()
    )


@pytest.mark.parametrize("zoom", [(1.0, 1.0), (2.0, 0.5)])
def test_the_errors_of_both_points_add(zoom):
    """Simulated: a place in an image that is ``zoom`` times as large, minus the same place seen anew there."""
    own, other = TRUTH, torch.tensor([[0.2, -0.1], [-0.1, 0.6]])
    here, there = residuals(100_000, own) * torch.tensor(zoom), residuals(200_000, other)[100_000:]
    claimed = residual_covariances(own[None], other[None], torch.tensor(zoom))[0]
    torch.testing.assert_close(torch.cov((here - there).T), claimed, rtol=0.03, atol=0.02)


def test_it_is_least_for_the_truth():
    residual = residuals(20_000)
    wrong = (TRUTH * 2, TRUTH / 2, torch.diag(TRUTH.diag()), TRUTH.flip(0, 1))
    losses = [gaussian_nll(residual, one.expand(len(residual), 2, 2)).mean() for one in (TRUTH, *wrong)]
    assert min(losses[1:]) > losses[0] + 0.02

"""The residual function of each cluster, fit to the pictures through the relief [WDR11 §4.1].

Pixel p of view v sees sum_k P_v[p, k] F_k(v, .), where P_v sums what it sees of the texels of a
cluster. The best F of each pair solves K normal equations. Where the surface is flat, that is the
mean error of the texels of each cluster.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from ...data import BTF
from ...model.lookup import SparseWeights
from ...runtime.ranks import Ranks
from ...runtime.sparse import sparse_product
from .lookups import Lookups
from .matrices import channel_matrices, solve_with_ridge
from .pictures import pictures_of

# Ridge relative to the mean diagonal: no pixel may see a cluster at grazing views.
RIDGE = 1e-6


@dataclass(frozen=True)
class LeftOver:
    """What lobes and components leave of the pictures, as seen by the clusters.

    Attributes:
        products: P_v^T E_v, `[V, K, L, C]`.
        gram: P_v^T P_v, `[V, K, K]`.
        energy: sum of E^2 over pixels, `[V, L, C]` float64.
        value: sum of the squares of the pictures, `[V, L, C]` float64.
        means: of n ||mean||^2 of the pixels of each cluster, `[V, L, C]` float64.
    """

    products: Tensor
    gram: Tensor
    energy: Tensor
    value: Tensor
    means: Tensor

    def functions(self) -> Tensor:
        """The functions of least error, `[K, V, L, C]`."""
        found = solve_with_ridge(self.gram, self.products.flatten(2), RIDGE)
        return found.view_as(self.products).transpose(0, 1)

    def error(self, functions: Tensor | None, scale: Tensor | None) -> float:
        """Squared error that functions leave, with pairs weighted.

        Args:
            functions: `[K, V, L, C]`; None: none.
            scale: square roots of the weights of pairs, `[D]`; None: 1.
        """
        left = self.energy  # [V, L, C]
        if functions is not None:
            own = functions.transpose(0, 1).flatten(2)  # [V, K, L C]
            change = (own * (self.gram @ own - 2.0 * self.products.flatten(2))).double().sum(1)
            left = left + change.view_as(left)
        return _total(left, scale)

    def value_energy(self, scale: Tensor | None) -> float:
        """Sum of the squares of the pictures, with pairs weighted by `scale [D]` squared."""
        return _total(self.value, scale)

    def mean_error(self, scale: Tensor | None) -> float:
        """Squared error of the mean of each cluster, with pairs weighted by `scale [D]` squared."""
        return _total(self.value - self.means, scale)


def _total(squares: Tensor, scale: Tensor | None) -> float:
    """The sum of `squares [V, L, C]`, weighted by `scale [D]` squared."""
    if scale is not None:
        squares = squares * scale.double().square().view(*squares.shape[:2], 1)
    return max(float(squares.sum()), 0.0)


def left_over(
    pictures: BTF,
    lookups: Lookups,
    entries: SparseWeights,
    rho: Tensor,
    labels: Tensor,
    ranks: Ranks,
    advance: Callable[[int], object],
    *,
    components: tuple[Tensor, Tensor] | None = None,
    own: Tensor | None = None,
) -> LeftOver:
    """Reads all pictures once more; every rank has a part of the views.

    Args:
        pictures: as they were measured.
        lookups: what each pixel shows, with the weights of pixels.
        entries: fit of all texels.
        rho: values of the lobes without weights, `[V, J, L]`.
        labels: clusters of the texels, `[T]`.
        ranks: processes among which the views are divided.
        advance: called with the number of views done.
        components: functions `[V, R, L, C]` and coefficients `[T, R]`; None: none.
        own: functions of the clusters, `[K, V, L, C]`; None: none.
    """
    device, shape = rho.device, (len(pictures.light), pictures.channels)
    member = one_hot(labels.to(device)).float()  # [T, K]
    views, clusters = lookups.views, member.shape[1]
    products = torch.zeros(views, clusters, *shape, device=device)
    gram = torch.zeros(views, clusters, clusters, device=device)
    energy, value_energy, means = torch.zeros(3, views, *shape, dtype=torch.float64, device=device)
    pixels = member if lookups.pixel is None else member * lookups.pixel[:, None]
    count = pixels.double().square().sum(0)
    weights = channel_matrices(entries, rho.shape[1])
    for view in ranks.share(torch.arange(views)).tolist():
        shown = [sparse_product(weight, rho[view]) for weight in weights]
        value = torch.stack(shown, dim=-1)  # [T, L, C]
        if components is not None:
            functions, coefficient = components
            value += torch.einsum("tr,rlc->tlc", coefficient, functions[view])
        if own is not None:
            value += own[:, view][labels.to(device)]
        run = slice(view, view + 1)
        picture = pictures_of(pictures, run, lookups, device)[0]  # [T, L C]
        drawn = lookups.drawn(run)
        left = picture - sparse_product(drawn, value.flatten(1))
        seen = sparse_product(drawn, member)  # [T, K]
        products[view] = (seen.T @ left).view(-1, *shape)
        gram[view] = seen.T @ seen
        energy[view] = left.double().square().sum(0).view(shape)
        value_energy[view] = picture.double().square().sum(0).view(shape)
        total = (pixels.T @ picture).double()  # [K, L C]
        means[view] = (total.square() / count[:, None]).sum(0).view(shape)
        advance(ranks.size)
    parts = (products, gram, energy, value_energy, means)
    return LeftOver(*(ranks.sum(part) for part in parts))

"""Sampling of texels' mixtures: the density is that of the samples, at texels and between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.sampling import specular_mask
from spmm_torch.model import sampling
from spmm_torch.model.sampling import (
    MIN_COSINE_PROBABILITY,
    SAMPLED_WIDTH,
    SamplingData,
    pdf,
    residual_intensity,
    sample,
)
from tests.chi2 import check
from tests.lobes.lobe_cases import KAPPA, POLAR_DEGREES, VIEW_AZIMUTH, lobe, unit_vector

LOBES = LobeBatch.cat(
    [
        lobe("lambertian", (), 20.0),
        lobe("oren_nayar", (0.6,), 0.0),
        lobe("ward", (0.05, 0.08), 8.0),
        lobe("blinn_phong", (300.0,), 30.0, azimuth=2.0),
        lobe("cook_torrance", (0.1, 0.3), 15.0, azimuth=-1.0),
        lobe("lafortune", (-0.95, 60.0), 0.0),
        lobe("ashikhmin_shirley", (50.0, 400.0, 0.3), 20.0),
        lobe("ward_duer", (0.2, 0.1), 60.0, azimuth=VIEW_AZIMUTH + math.pi),
        *(lobe(name, KAPPA[name]["wide"], 20.0) for name in MODEL_NAMES[8:]),
    ]
)
# Glossy; everything at once; diffuse; nothing; one lobe that steep views from VIEW_AZIMUTH miss.
TEXELS = ((0, 2), tuple(range(len(LOBES))), (0, 1), (), (7,))
GLOSSY, ALL, DIFFUSE, EMPTY, HIDDEN = range(5)
COUNTS = [len(texel) for texel in TEXELS]
MIXED = torch.tensor([[GLOSSY, ALL, DIFFUSE, HIDDEN]])
SHARES = torch.tensor([[0.4, 0.3, 0.2, 0.1]], dtype=torch.float64)
MIX = dict(zip(MIXED[0].tolist(), SHARES[0].tolist(), strict=True))


@dataclass(frozen=True)
class Planted:
    """Texels made of LOBES, and a query for a mix of them."""

    offset: Tensor
    index: Tensor
    weight: Tensor
    rest: Tensor

    def data(self, dtype: torch.dtype = torch.float64) -> SamplingData:
        parts = (part.to(dtype) for part in (LOBES.kappa, LOBES.normal, LOBES.angle))
        lobes = LobeBatch(LOBES.model, *parts)
        weight, rest = self.weight.to(dtype), self.rest.to(dtype)
        return SamplingData.build(lobes, self.offset, self.index, weight, rest)

    def value(self, texel: int, wi: Tensor, wo: Tensor) -> Tensor:
        """Mean over channels of texel's lobes at wi, wo `[N, 3]`: `[N]`."""
        entries = slice(int(self.offset[texel]), int(self.offset[texel + 1]))
        rho = LOBES[self.index[entries]].eval(wi[None], wo[None])
        return (self.weight[entries].mean(dim=1)[:, None] * rho).sum(dim=0)


@pytest.fixture(scope="module")
def planted() -> Planted:
    generator = torch.Generator().manual_seed(11)
    weight = 0.2 + 0.8 * torch.rand(sum(COUNTS), 3, generator=generator, dtype=torch.float64)
    index = torch.tensor([entry for texel in TEXELS for entry in texel])
    offset = torch.tensor([0, *COUNTS]).cumsum(0)
    return Planted(offset, index, weight, torch.full((5,), 0.01, dtype=torch.float64))


def query(texel: int | None, wo: Tensor, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """(texel, share, wo) for each row of `like [N, 3]`; None is the mix of several texels."""
    where = MIXED if texel is None else torch.tensor([[texel, 0, 1, 2]])
    share = SHARES if texel is None else torch.tensor([[1.0, 0.0, 0.0, 0.0]])
    count = len(like)
    return where.expand(count, 4), share.to(like).expand(count, 4), wo.to(like).expand(count, 3)


def drawn(data: SamplingData, texel: int | None, wo: Tensor, u: Tensor) -> Tensor:
    return sample(data, *query(texel, wo, u), u)[0]


def density(data: SamplingData, texel: int | None, wo: Tensor, wi: Tensor) -> Tensor:
    where, share, wo = query(texel, wo, wi)
    return pdf(data, where, share, wi, wo)


def uniform(count: int, seed: int = 1, dtype: torch.dtype = torch.float64) -> Tensor:
    return torch.rand(count, 3, generator=torch.Generator().manual_seed(seed), dtype=dtype)


VIEWS = [
    pytest.param(unit_vector(polar, VIEW_AZIMUTH), id=name) for name, polar in POLAR_DEGREES.items()
]
MIXTURE_IDS = [GLOSSY, ALL, HIDDEN, None]
MIXTURES = [
    pytest.param(texel, id=name)
    for texel, name in ((GLOSSY, "glossy"), (ALL, "all"), (HIDDEN, "hidden"), (None, "mixed"))
]


@pytest.mark.parametrize("wo", VIEWS)
@pytest.mark.parametrize("texel", MIXTURES)
def test_chi_square(planted: Planted, texel: int | None, wo: Tensor) -> None:
    data = planted.data()
    seed = 40 + MIXTURE_IDS.index(texel)
    outcome = check(
        partial(drawn, data, texel, wo), partial(density, data, texel, wo), 50_000, 16, 32, seed
    )
    assert outcome.accepted, outcome


@pytest.mark.slow
@pytest.mark.parametrize("wo", VIEWS)
@pytest.mark.parametrize("texel", MIXTURES)
def test_chi_square_of_a_million(planted: Planted, texel: int | None, wo: Tensor) -> None:
    data = planted.data()
    seed = 80 + MIXTURE_IDS.index(texel)
    outcome = check(
        partial(drawn, data, texel, wo),
        partial(density, data, texel, wo),
        1_000_000,
        100,
        200,
        seed,
    )
    assert outcome.accepted, outcome


@pytest.mark.parametrize("wo", VIEWS)
@pytest.mark.parametrize("texel", MIXTURES)
def test_the_returned_density_is_that_of_pdf(
    planted: Planted, texel: int | None, wo: Tensor
) -> None:
    data, u = planted.data(), uniform(500)
    wi, found = sample(data, *query(texel, wo, u), u)
    torch.testing.assert_close(found, density(data, texel, wo, wi))


@pytest.mark.parametrize("wo", VIEWS)
@pytest.mark.parametrize("texel", MIXTURES)
def test_albedo_by_sampling_is_the_sum_of_its_lobes(
    planted: Planted, texel: int | None, wo: Tensor
) -> None:
    """Against sampling each lobe alone, which is checked by quadrature elsewhere."""
    data = planted.data()
    u = torch.quasirandom.SobolEngine(3, scramble=True, seed=5).draw(1 << 14).double()
    wi, found = sample(data, *query(texel, wo, u), u)
    views = wo.expand(len(u), 3)
    shares = {texel: 1.0} if texel is not None else MIX
    estimate = sum(
        share * float((planted.value(place, wi, views) / found).mean())
        for place, share in shares.items()
    )
    exact = 0.0
    for place, share in shares.items():
        for entry in range(int(planted.offset[place]), int(planted.offset[place + 1])):
            index = planted.index[entry].expand(len(u))
            alone = data.table.sample(index, views, u)
            rho = LOBES[index[:1]].eval(alone[None], views[None])[0]
            albedo = float(
                (rho / data.table.pdf(index, torch.arange(len(index)), alone, views)).mean()
            )
            exact += share * float(planted.weight[entry].mean()) * albedo
    assert estimate == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize("texel", [*range(5), None])
def test_every_direction_of_the_upper_hemisphere_can_be_sampled(
    planted: Planted, texel: int | None
) -> None:
    data, wi = planted.data(), square_to_cosine_hemisphere(uniform(2000)[:, :2])
    least = MIN_COSINE_PROBABILITY * square_to_cosine_hemisphere_pdf(wi)
    for polar in (0.0, 60.0, 89.0, 95.0):
        found = density(data, texel, unit_vector(polar, VIEW_AZIMUTH), wi)
        assert bool((found >= 0.999 * least).all())
        below = wi * torch.tensor([1.0, 1.0, -1.0])
        assert float(density(data, texel, unit_vector(polar, 1.0), below).max()) == 0.0


@pytest.mark.parametrize(("texel", "polar"), [(DIFFUSE, 30.0), (EMPTY, 30.0), (HIDDEN, 60.0)])
def test_without_a_specular_lobe_in_view_it_is_the_cosine_lobe(
    planted: Planted, texel: int, polar: float
) -> None:
    data, u, wo = planted.data(), uniform(100), unit_vector(polar, VIEW_AZIMUTH)
    wi = drawn(data, texel, wo, u)
    torch.testing.assert_close(wi, square_to_cosine_hemisphere(u[:, 1:]))
    torch.testing.assert_close(density(data, texel, wo, wi), square_to_cosine_hemisphere_pdf(wi))


def test_weights_of_the_specular_group_are_bounded(planted: Planted) -> None:
    """By the bound of a lone lobe (4 for the worst) over the least probability of one."""
    data = planted.data()
    mask = torch.zeros(len(LOBES), dtype=torch.bool)
    mask[data.index.long()] = True
    for texel in (GLOSSY, ALL):
        first, last = int(data.offset[texel]), int(data.offset[texel + 1])
        gamma = data.gamma[first:last].double()
        group = float(data.group[texel]) / sampling.CODE_MAX
        entries = [
            e
            for e in range(int(planted.offset[texel]), int(planted.offset[texel + 1]))
            if bool(mask[planted.index[e]])
        ]
        alpha = planted.weight[entries].mean(dim=1)
        bound = float((4.0 * alpha * gamma.sum() / (group * gamma)).max())
        for polar in (0.0, 50.0, 85.0):
            wo = unit_vector(polar, VIEW_AZIMUTH)
            wi = drawn(data, texel, wo, uniform(20_000))
            rho = LOBES[planted.index[entries]].eval(wi[None], wo.expand(len(wi), 3)[None])
            weight = (alpha[:, None] * rho).sum(dim=0) / density(data, texel, wo, wi)
            assert float(weight.max()) <= bound


@pytest.mark.parametrize("polar", [10.0, 45.0, 70.0])
def test_variance_is_far_below_that_of_cosine_sampling(planted: Planted, polar: float) -> None:
    """Under a sky that brightens upward, at equal sample count, on a glossy texel."""
    data, u, wo = planted.data(), uniform(200_000), unit_vector(polar, VIEW_AZIMUTH)

    def variance(wi: Tensor, found: Tensor) -> Tensor:
        return (planted.value(GLOSSY, wi, wo.expand(len(u), 3)) * (0.5 + wi[:, 2]) / found).var()

    ours = drawn(data, GLOSSY, wo, u)
    cosine = square_to_cosine_hemisphere(u[:, 1:])
    plain = variance(cosine, square_to_cosine_hemisphere_pdf(cosine))
    assert float(plain / variance(ours, density(data, GLOSSY, wo, ours))) > 20.0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_edges_of_the_square(planted: Planted, dtype: torch.dtype) -> None:
    edge = torch.tensor([0.0, 0.3, 1.0 - torch.finfo(dtype).eps / 2.0], dtype=dtype)
    u = torch.cartesian_prod(edge, edge, edge)
    for texel in (*range(5), None):
        for polar in (0.0, 89.0, 90.0, 120.0):
            wi, found = sample(planted.data(dtype), *query(texel, unit_vector(polar, 0.3), u), u)
            assert wi.dtype == found.dtype == dtype
            assert bool((wi[:, 2] > 0.0).all())
            assert bool((found.isfinite() & (found > 0.0)).all())


def test_queries_of_float64_on_a_model_of_float32(planted: Planted) -> None:
    u = uniform(50)
    wi, found = sample(planted.data(torch.float32), *query(None, unit_vector(40.0, 0.3), u), u)
    assert wi.dtype == found.dtype == torch.float64


def test_block_size_changes_nothing(planted: Planted) -> None:
    data, u, wo = planted.data(), uniform(200), unit_vector(40.0, 0.3)
    whole = sample(data, *query(None, wo, u), u)
    block = 7 * 4 * data.longest
    torch.testing.assert_close(sample(data, *query(None, wo, u), u, block=block), whole)
    where, share, views = query(None, wo, whole[0])
    torch.testing.assert_close(pdf(data, where, share, whole[0], views, block=block), whole[1])


def test_no_query_is_fine(planted: Planted) -> None:
    wi, found = sample(planted.data(), *query(None, unit_vector(0.0, 0.0), uniform(0)), uniform(0))
    assert (wi.shape, found.shape) == ((0, 3), (0,))


def test_a_model_without_lobes_is_sampled_by_the_cosine(planted: Planted) -> None:
    none = torch.zeros(0, dtype=torch.long)
    weight, rest = torch.zeros(0, 3, dtype=torch.float64), torch.zeros(5, dtype=torch.float64)
    offset = torch.zeros(6, dtype=torch.long)
    for lobes in (LOBES, LOBES[none]):
        data = SamplingData.build(lobes, offset, none, weight, rest)
        u, wo = uniform(10), unit_vector(40.0, 0.3)
        torch.testing.assert_close(drawn(data, None, wo, u), square_to_cosine_hemisphere(u[:, 1:]))


def test_bytes_are_one_for_each_specular_entry_and_texel(planted: Planted) -> None:
    specular = int(specular_mask(LOBES, SAMPLED_WIDTH)[planted.index].sum())
    assert planted.data().bytes() == specular + len(TEXELS)


def test_gamma_follows_the_weights(planted: Planted) -> None:
    """[WDR11 Eq. 9]: a weight ten times as large, ten times the odds."""
    weight = planted.weight.clone()
    rows = slice(int(planted.offset[ALL]), int(planted.offset[ALL + 1]))
    before = Planted(planted.offset, planted.index, weight.clone(), planted.rest).data()
    weight[rows][6] *= 10.0
    after = Planted(planted.offset, planted.index, weight, planted.rest).data()
    first = int(before.offset[ALL])
    odds = [float(data.gamma[first + 4]) / float(data.gamma[first + 3]) for data in (before, after)]
    assert odds[1] / odds[0] == pytest.approx(10.0, rel=0.25)
    assert int(after.group[ALL]) > int(before.group[ALL])


def test_residual_intensity_is_the_mean_size() -> None:
    code = torch.tensor([[1.0, -3.0], [0.0, 2.0]]).view(2, 2, 1, 1).half()
    found = residual_intensity(code, torch.tensor([0.5, 2.0]))
    torch.testing.assert_close(found, torch.tensor([1.0, 2.0]))


@pytest.mark.gpu
def test_the_same_on_cuda(planted: Planted) -> None:
    data, u, wo = planted.data(), uniform(2000), unit_vector(40.0, 0.3)
    there = data.to("cuda")
    parts = query(None, wo, u)
    wi, found = sample(there, *(part.cuda() for part in parts), u.cuda())
    expected = sample(data, *parts, u)
    torch.testing.assert_close(wi.cpu(), expected[0])
    torch.testing.assert_close(found.cpu(), expected[1])


def test_every_model_takes_part() -> None:
    assert set(LOBES.names()) == set(KAPPA)

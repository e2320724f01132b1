"""Padded tables against ragged lists: equal values, and what torch can do with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad
from torch.func import functional_call, hessian, jacfwd, jacrev, jvp, vmap

from spmm_torch import SPMM, DataError
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import MIRROR, direction_from_angles, ring_directions
from spmm_torch.model import ragged
from spmm_torch.model.dense import DenseTables
from tests.planted.directions import random_directions
from tests.planted.models import planted_relief, uneven_model, with_components, with_relief

HEIGHT, WIDTH = 2, 3
COUNTS = (0, 1, len(MODEL_NAMES), 2, 4, 3)
LIGHT = ring_directions(((0.0, 1), (35.0, 6), (70.0, 10)))
VIEW = ring_directions(((0.0, 1), (40.0, 7)))
QUERIES = ("uv", "wi", "wo")
# All on one side: a query on the other has no cell, and takes the nearest direction.
ONE_SIDE = direction_from_angles(torch.tensor([0.3, 0.9, 1.1, 0.8]), torch.tensor([0.0, 0.4, 1, 2]))


def build(light: Tensor = LIGHT, view: Tensor = VIEW, counts: tuple[int, ...] = COUNTS) -> SPMM:
    return uneven_model(counts, HEIGHT, light, view, precision=torch.float32).double()


def everything() -> SPMM:
    """With clusters, components and a relief that is mirrored."""
    relief = planted_relief(HEIGHT, WIDTH, 0.3, MIRROR)
    return with_relief(with_components(build().float(), beside=True), relief).double()


MODELS: dict[str, Callable[[], SPMM]] = {
    "clusters": build,
    "components": lambda: with_components(build()).double(),
    "relief": lambda: with_relief(build().float(), planted_relief(HEIGHT, WIDTH, 0.3)).double(),
    "everything": everything,
    "one side": lambda: build(ONE_SIDE, ONE_SIDE),
    "two directions": lambda: build(LIGHT[:2], VIEW[:2]),
    "no lobe": lambda: build(counts=(0,) * 6),
}


@pytest.fixture(params=MODELS, ids=lambda name: name.replace(" ", "_"))
def model(request: pytest.FixtureRequest) -> SPMM:
    return MODELS[request.param]()


def queries(count: int = 40) -> tuple[Tensor, Tensor, Tensor]:
    """uv in several copies of the texture; some directions are under the horizon."""
    uv = 3.0 * torch.rand(count, 2, generator=torch.Generator().manual_seed(1)).double() - 1.0
    wi, wo = (random_directions(count, seed, max_theta=1.65) for seed in (2, 3))
    return uv, wi, wo


@pytest.mark.parametrize("residual", [False, True])
def test_both_ways_give_the_same_values(model: SPMM, residual: bool) -> None:
    given = queries()
    ragged = model(*given, residual=residual, padded=False)
    padded = model(*given, residual=residual, padded=True)
    torch.testing.assert_close(padded, ragged, rtol=1e-12, atol=1e-14)


def test_measured_directions_of_both_ways() -> None:
    model = build()
    uv = torch.full((len(LIGHT), 2), 0.4).double()
    wo = VIEW[3].double().expand(len(LIGHT), 3)
    both = [model(uv, LIGHT.double(), wo, padded=way) for way in (False, True)]
    torch.testing.assert_close(*both, rtol=1e-12, atol=1e-14)


def test_single_precision_and_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    model = everything().float()
    given = [part.float() for part in queries()]
    whole = model(*given, padded=True)
    torch.testing.assert_close(whole, model(*given), rtol=1e-4, atol=1e-5)
    monkeypatch.setattr(ragged, "EVALUATED_ENTRIES", 300)
    torch.testing.assert_close(model(*given, padded=True), whole, rtol=1e-5, atol=1e-6)


def test_tables_follow_the_entries() -> None:
    model, other = build(), build(counts=COUNTS[::-1])
    before = model.padded_tables()
    assert model.padded_tables() is before
    model.offset.copy_(other.offset)
    model.index.copy_(other.index)
    given = queries(8)
    torch.testing.assert_close(model(*given, padded=True), model(*given))
    model.load_state_dict(build().state_dict(), assign=True)
    torch.testing.assert_close(model(*given, padded=True), build()(*given))


def test_places_of_a_texel_are_those_of_the_fullest() -> None:
    model = torch.tensor([4, 4, 2, 4])
    offset, index = torch.tensor([0, 1, 4, 4, 5]), torch.tensor([2, 0, 1, 3, 2])
    tables = DenseTables.build(offset, index, model)
    found = {group.model: group.entry.tolist() for group in tables.groups}
    assert found == {2: [[0], [5], [5], [4]], 4: [[5, 5, 5], [1, 2, 3], [5, 5, 5], [5, 5, 5]]}
    assert tables.places == 4


def test_vmap_over_queries(model: SPMM) -> None:
    given = queries(6)
    torch.testing.assert_close(vmap(model)(*given), model(*given), rtol=1e-12, atol=1e-14)


def test_vmap_over_reliefs() -> None:
    model, given = everything(), queries(6)
    assert model.relief is not None
    height = model.relief.height.detach()
    heights = torch.stack((height, 0.5 * height, height.flip(0)))

    def value(height: Tensor) -> Tensor:
        return functional_call(model, {"relief.height": height}, given)

    torch.testing.assert_close(vmap(value)(heights), torch.stack([value(h) for h in heights]))


@pytest.mark.parametrize("argument", [0, 1, 2], ids=["uv", "wi", "wo"])
def test_derivatives_by_functions_are_those_of_autograd(argument: int) -> None:
    model = everything()
    uv = 0.8 * torch.rand(4, 2, generator=torch.Generator().manual_seed(1)).double()
    given = [uv, *(random_directions(4, seed, max_theta=1.2) for seed in (2, 3))]
    given[argument].requires_grad_()
    value = model(*given)
    exact = torch.stack(
        [
            torch.autograd.grad(value[:, c].sum(), given[argument], retain_graph=True)[0]
            for c in range(3)
        ],
        dim=1,
    )
    given = [part.detach() for part in given]
    forward = vmap(jacfwd(model, argnums=argument))(*given)
    backward = vmap(jacrev(model, argnums=argument))(*given)

    def moved(x: Tensor) -> Tensor:
        return model(*given[:argument], x, *given[argument + 1 :])

    direction = torch.ones_like(given[argument])
    slope = jvp(moved, (given[argument],), (direction,))[1]
    for found, expected in ((forward, exact), (backward, exact), (slope, exact.sum(-1))):
        torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


def test_derivative_of_parameters_by_functions() -> None:
    model, given = everything(), queries(5)
    names = ("weight", "kappa", "normal", "angle", "relief.height")
    for name, parameter in model.named_parameters():
        parameter.requires_grad_(name in names)
    model(*given).square().sum().backward()
    held = {name: parameter.detach() for name, parameter in model.named_parameters()}

    def loss(chosen: dict[str, Tensor]) -> Tensor:
        return functional_call(model, {**held, **chosen}, given).square().sum()

    found = torch.func.grad(loss)({name: held[name] for name in names})
    for name in names:
        expected = model.get_parameter(name).grad
        torch.testing.assert_close(found[name], expected, rtol=1e-9, atol=1e-12)


def simple() -> SPMM:
    """Few BRDFs, and all else: torch takes its time to follow a model."""
    model = uneven_model((1, 2), 1, LIGHT, VIEW, names=("lambertian", "ggx"))
    return with_relief(with_components(model, beside=True), planted_relief(1, 2, 0.3)).double()


def test_one_graph_serves_all_sizes_of_a_batch() -> None:
    model, graphs = simple(), []

    def backend(graph: torch.fx.GraphModule, _: list[Tensor]) -> Callable[..., object]:
        graphs.append(graph)
        return graph.forward

    compiled = torch.compile(model, backend=backend, dynamic=True, fullgraph=True)
    with torch.no_grad():
        # torch takes sizes that are alike in the first call for one: none of the model's is 101.
        for count in (101, 3, 40):
            given = queries(count)
            torch.testing.assert_close(compiled(*given), model(*given), rtol=1e-12, atol=1e-14)
    assert len(graphs) == 1
    torch.compiler.reset()


@pytest.mark.parametrize("build", [simple, pytest.param(everything, marks=pytest.mark.slow)])
def test_what_is_exported_takes_any_batch(build: Callable[[], SPMM]) -> None:
    model = build()
    batch = torch.export.Dim("batch")
    sizes = {name: {0: batch} for name in QUERIES}
    program = torch.export.export(model, queries(5), dynamic_shapes=sizes).module()
    for count in (5, 2, 30):
        given = queries(count)
        torch.testing.assert_close(program(*given), model(*given), rtol=1e-12, atol=1e-14)


@pytest.mark.slow
def test_a_program_of_a_saved_model_is_saved(tmp_path: Path) -> None:
    """Without a residual of clusters, as fits are: its tensors are empty."""
    made = uneven_model((1, 1), 1, LIGHT, VIEW, names=("lambertian",))
    with_components(made).save(tmp_path / "model.safetensors")
    model = SPMM.load(tmp_path)
    batch = {0: torch.export.Dim("batch")}
    given = tuple(part.float() for part in queries(5))
    program = torch.export.export(model, given, dynamic_shapes=dict.fromkeys(QUERIES, batch))
    torch.export.save(program, tmp_path / "model.pt2")
    loaded = torch.export.load(tmp_path / "model.pt2").module()
    given = tuple(part.float() for part in queries(30))
    torch.testing.assert_close(loaded(*given), model(*given), rtol=1e-4, atol=1e-5)


def test_forward_derivatives_without_functions() -> None:
    model, (uv, wi, wo) = everything(), queries(5)
    direction = torch.ones_like(wi)
    expected = jvp(lambda wi: model(uv, wi, wo), (wi,), (direction,))[1]
    with forward_ad.dual_level():
        value = model(uv, forward_ad.make_dual(wi, direction), wo)
        torch.testing.assert_close(forward_ad.unpack_dual(value).tangent, expected)


def test_second_derivatives_by_padded_tables() -> None:
    model, (uv, wi, wo) = everything(), queries(5)
    wi.requires_grad_()
    value = model(uv, wi, wo, padded=True).sum()
    (slope,) = torch.autograd.grad(value, wi, create_graph=True)
    (found,) = torch.autograd.grad(slope.sum(), wi)
    curved = vmap(hessian(lambda uv, wi, wo: model(uv, wi, wo).sum(), argnums=1))
    expected = curved(uv, wi.detach(), wo).sum(1)
    torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("registered", [False, True])
def test_pictures_are_transformed(model: SPMM, registered: bool) -> None:
    _, wi, wo = queries(3)

    def picture(wi: Tensor, wo: Tensor) -> Tensor:
        return model.picture(wi, wo, registered=registered)

    given = wi, torch.cat((wo[:2], model.view[:1].double()))
    expected = torch.stack([picture(*pair) for pair in zip(*given, strict=True)])
    torch.testing.assert_close(vmap(picture)(*given), expected, rtol=1e-5, atol=1e-7)
    light = wi[0].clone().requires_grad_()
    (slope,) = torch.autograd.grad(picture(light, wo[0]).sum(), light)
    found = jacrev(lambda wi: picture(wi, wo[0]).sum())(light.detach())
    torch.testing.assert_close(found, slope, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["sample", "pdf"])
def test_what_sorts_by_values_refuses_transforms(name: str) -> None:
    uv, wi, wo = queries(3)
    given = (uv, wo, wi.abs()) if name == "sample" else (uv, wi, wo)
    with pytest.raises(DataError, match=rf"^{name} was called under vmap, .*; give it all"):
        vmap(getattr(build(), name))(*given)


@pytest.mark.slow
def test_compiled_code() -> None:
    model = everything().float()
    compiled = torch.compile(model, dynamic=True, fullgraph=True)
    with torch.no_grad():
        for count in (7, 40):
            given = [part.float() for part in queries(count)]
            torch.testing.assert_close(compiled(*given), model(*given), rtol=1e-4, atol=1e-5)
    torch.compiler.reset()

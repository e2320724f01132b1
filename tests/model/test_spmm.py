"""A small planted model against a direct sum over its lobes, written without its bookkeeping."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM, DataError, OutputError
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import direction_from_angles, ring_directions
from spmm_torch.model import ragged
from spmm_torch.runtime import tensor_file
from tests.planted.directions import random_directions
from tests.planted.models import uneven_model, with_components

HEIGHT, WIDTH, CLUSTERS, NAME = 3, 4, 2, "wool · felt"
LIGHT = ring_directions(((0.0, 1), (35.0, 6), (70.0, 10)))
VIEW = ring_directions(((0.0, 1), (40.0, 7)))
# Texels 0, 5 and the last have no lobes; texel 2 has them all.
COUNTS = (0, 1, len(MODEL_NAMES), 2, 3, 0, 1, 2, 4, 1, 1, 0)


def build(counts: tuple[int, ...] = COUNTS, precision: torch.dtype = torch.float16) -> SPMM:
    return uneven_model(counts, HEIGHT, LIGHT, VIEW, CLUSTERS, precision=precision, name=NAME)


@pytest.fixture(params=["clusters", "components", "both"])
def model(request: pytest.FixtureRequest) -> SPMM:
    """With a residual of clusters, of rank R, or of both."""
    built = build()
    if request.param == "clusters":
        return built
    return with_components(built, beside=request.param == "both")


def centre(texel: int) -> Tensor:
    row, column = divmod(texel, WIDTH)
    return torch.tensor([(column + 0.5) / WIDTH, 1.0 - (row + 0.5) / HEIGHT])


def all_centres() -> Tensor:
    return torch.stack([centre(texel) for texel in range(HEIGHT * WIDTH)])


def directions(count: int, seed: int) -> Tensor:
    return random_directions(count, seed, max_theta=1.5, dtype=torch.float32)


def direct(model: SPMM, texel: int, wi: Tensor, wo: Tensor, residual: bool = True) -> Tensor:
    """[WDR11 Eq. 2] of one texel, one lobe after the other: `[Q, 3]`."""
    total = torch.zeros(len(wi), 3)
    for entry in range(sum(COUNTS[:texel]), sum(COUNTS[: texel + 1])):
        lobe = model.dictionary[model.index[entry : entry + 1]]
        total = total + lobe.eval(wi[None], wo[None])[0][:, None] * model.weight[entry]
    if residual:
        total = total + model.residual(model.labels[texel].expand(len(wi)), wi, wo)
        if model.components is not None:
            total = total + model.components(torch.tensor(texel), wi, wo)
    return total


@pytest.mark.parametrize("residual", [False, True])
def test_texel_centres_are_the_sum_of_their_lobes(model: SPMM, residual: bool) -> None:
    wi, wo = directions(40, 1), directions(40, 2)
    for texel in range(HEIGHT * WIDTH):
        found = model(centre(texel), wi, wo, residual=residual)
        torch.testing.assert_close(
            found, direct(model, texel, wi, wo, residual), rtol=1e-5, atol=2e-6
        )


def test_bilinear_between_centres(model: SPMM) -> None:
    wi, wo = directions(8, 3), directions(8, 4)
    left, right, below = centre(1), centre(2), centre(5)
    value = {texel: direct(model, texel, wi, wo) for texel in (1, 2, 5, 6, 0, 3, 8)}
    found = model(0.75 * left + 0.25 * right, wi, wo)
    torch.testing.assert_close(found, 0.75 * value[1] + 0.25 * value[2], rtol=1e-4, atol=1e-5)
    found = model(0.5 * left + 0.5 * below, wi, wo)
    torch.testing.assert_close(found, 0.5 * value[1] + 0.5 * value[5], rtol=1e-4, atol=1e-5)
    middle = 0.25 * (value[1] + value[2] + value[5] + value[6])
    corner = torch.tensor([right[0] + left[0], left[1] + below[1]]) / 2.0
    torch.testing.assert_close(model(corner, wi, wo), middle, rtol=1e-4, atol=1e-5)


def test_texture_repeats(model: SPMM) -> None:
    wi, wo = directions(6, 5), directions(6, 6)
    edge = torch.tensor([0.0, float(centre(0)[1])])  # between column 3 and column 0
    expected = 0.5 * (direct(model, 0, wi, wo) + direct(model, 3, wi, wo))
    torch.testing.assert_close(model(edge, wi, wo), expected, rtol=1e-4, atol=1e-5)
    uv = torch.rand(6, 2, generator=torch.Generator().manual_seed(1))
    for shift in ([1.0, 0.0], [-2.0, 3.0]):
        torch.testing.assert_close(
            model(uv + torch.tensor(shift), wi, wo), model(uv, wi, wo), rtol=1e-4, atol=1e-4
        )


def test_shapes_broadcast(model: SPMM) -> None:
    uv, wi, wo = all_centres()[:5], directions(7, 1), directions(7, 2)
    grid = model(uv[:, None], wi, wo)
    assert grid.shape == (5, 7, 3)
    torch.testing.assert_close(grid[3], model(uv[3], wi, wo))
    torch.testing.assert_close(grid[:, 2], model(uv, wi[2], wo[2]))
    single = model(uv[3], wi[2], wo[2])
    assert single.shape == (3,)
    torch.testing.assert_close(single, grid[3, 2])
    assert model(uv[:0], wi[:1], wo[:1]).shape == (0, 3)


def test_block_size_changes_nothing(model: SPMM, monkeypatch: pytest.MonkeyPatch) -> None:
    uv, wi, wo = all_centres(), directions(12, 1), directions(12, 2)
    whole = model(uv, wi, wo)
    monkeypatch.setattr(ragged, "EVALUATED_ENTRIES", 1)
    torch.testing.assert_close(model(uv, wi, wo), whole)


def test_dark_under_the_horizon(model: SPMM) -> None:
    up = torch.tensor([0.0, 0.0, 1.0])
    for low in ([0.6, 0.0, -0.8], [1.0, 0.0, 0.0]):
        assert torch.equal(model(all_centres(), torch.tensor(low), up), torch.zeros(12, 3))
        assert torch.equal(model(all_centres(), up, torch.tensor(low)), torch.zeros(12, 3))


@torch.no_grad()
def test_values_end_at_the_horizon_of_the_light(model: SPMM) -> None:
    """Though some lobes lean towards the light."""
    wo, largest = directions(30, 2), {}
    for z in (1e-4, 1e-6):
        wi = direction_from_angles(torch.arccos(torch.full((30,), z)), torch.linspace(0.0, 6.0, 30))
        whole = model(all_centres()[:, None], wi, wo).abs().max()
        picture = model.picture(wi[0], wo[0]).abs().max()
        largest[z] = max(float(whole), float(picture))
    assert 0.0 < largest[1e-6] < 0.1 * largest[1e-4] < 0.01


def test_measured_lights_are_not_faded(model: SPMM) -> None:
    uv = all_centres()[:, None, None]
    found = model(uv, LIGHT[None, None], VIEW[None, :, None])
    model.lowest_light = 0.0
    assert torch.equal(model(uv, LIGHT[None, None], VIEW[None, :, None]), found)


@pytest.mark.parametrize("residual", [False, True])
def test_picture_is_forward_at_centres(model: SPMM, residual: bool) -> None:
    for wi, wo in ((LIGHT[9], VIEW[3]), (directions(1, 1)[0], directions(1, 2)[0])):
        found = model.picture(wi, wo, residual=residual)
        assert found.shape == (HEIGHT, WIDTH, 3)
        expected = model(all_centres(), wi, wo, residual=residual)
        torch.testing.assert_close(found.flatten(0, 1), expected, rtol=1e-5, atol=2e-6)


def test_gradients_reach_every_parameter(model: SPMM) -> None:
    uv = torch.rand(50, 2, generator=torch.Generator().manual_seed(2)).requires_grad_()
    wi = torch.cat((directions(49, 1), torch.tensor([[0.0, 0.0, 1.0]])))
    wo = torch.cat((directions(49, 2), torch.tensor([[0.0, 0.0, 1.0]])))
    model(uv, wi, wo).square().sum().backward()
    for tensor in (model.kappa, model.normal, model.angle, model.weight, uv):
        assert tensor.grad.isfinite().all()
        assert (tensor.grad != 0.0).any()
    assert model.residual.code.grad is None


def test_slope_along_uv(model: SPMM) -> None:
    """One-sided at a texel's centre, where the slope of the interpolation jumps."""
    wi, wo = directions(1, 1)[0], directions(1, 2)[0]
    start = torch.stack((centre(1), centre(2) + torch.tensor([0.05, 0.06]), centre(11)))
    step = torch.tensor([2e-3, -2e-3])  # to the right and down, where the neighbours are
    for axis in (0, 1):
        move = step * torch.eye(2)[axis]
        uv = start.clone().requires_grad_()
        model(uv, wi, wo).sum(1).backward(torch.ones(3))
        with torch.no_grad():
            change = (model(start + move, wi, wo) - model(start, wi, wo)).sum(1)
        torch.testing.assert_close(uv.grad[:, axis], change / step[axis], rtol=2e-2, atol=5e-3)


def test_texels_without_lobes() -> None:
    empty = build((0,) * (HEIGHT * WIDTH))
    wi, wo = directions(12, 1), directions(12, 2)
    assert torch.equal(empty(all_centres(), wi, wo, residual=False), torch.zeros(12, 3))
    assert torch.equal(empty.picture(wi[0], wo[0], residual=False), torch.zeros(3, 4, 3))
    expected = empty.residual(empty.labels, wi, wo)
    torch.testing.assert_close(empty(all_centres(), wi, wo), expected, rtol=1e-5, atol=1e-5)
    assert empty.lobe_use_by_model() == {}


def test_counts(model: SPMM) -> None:
    assert model.lobe_count_per_texel().tolist() == list(COUNTS)
    assert (model.texel_count, model.cluster_count) == (12, CLUSTERS)
    assert len(model.dictionary) == len(MODEL_NAMES)
    use = model.lobe_use_by_model()
    assert sum(use.values()) == sum(COUNTS)
    assert list(use.values()) == sorted(use.values(), reverse=True)
    for name, count in use.items():
        lobe = MODEL_NAMES.index(name)
        assert count == int((model.index == lobe).sum())


@pytest.mark.parametrize("counts", [COUNTS, (0,) * (HEIGHT * WIDTH)])
@pytest.mark.parametrize("precision", [torch.float16, torch.float32])
def test_round_trip(tmp_path: Path, counts: tuple[int, ...], precision: torch.dtype) -> None:
    model = build(counts, precision)
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(model.pack())
    loaded = SPMM.load(tmp_path)
    assert (loaded.height, loaded.width, loaded.name) == (HEIGHT, WIDTH, NAME)
    assert torch.equal(loaded.lobe_model, model.lobe_model)
    theirs = loaded.state_dict()
    for name, tensor in model.state_dict().items():
        assert theirs[name].dtype == tensor.dtype
        assert torch.equal(theirs[name], tensor), name
    wi, wo = directions(12, 1), directions(12, 2)
    assert torch.equal(loaded(all_centres(), wi, wo), model(all_centres(), wi, wo))
    assert loaded.pack() == model.pack()
    assert SPMM.load(tmp_path / tensor_file.MODEL_FILE).pack() == model.pack()


def test_a_file_that_cannot_be_written_ends_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for place in (tmp_path / "no" / "x.safetensors", tmp_path / "file" / "x.safetensors"):
        with pytest.raises(OutputError, match=r"x.safetensors cannot be written .*; choose"):
            build().save(place)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_horizon_needs_version_2(tmp_path: Path, model: SPMM) -> None:
    """Older readers, which would cut lobes hard, refuse the file; other files stay as they were."""
    model.horizon = 0.0
    assert model.to_tensors()[1]["version"] == ("1" if model.components is None else "2")
    assert "horizon" not in model.to_tensors()[1]
    model.horizon = math.radians(7.0)
    assert model.to_tensors()[1]["version"] == "2"
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(model.pack())
    loaded = SPMM.load(tmp_path)
    assert loaded.horizon == loaded.dictionary.horizon == math.radians(7.0)
    wi, wo = directions(12, 1), directions(12, 2)
    assert torch.equal(
        loaded(all_centres()[:, None], wi, wo), model(all_centres()[:, None], wi, wo)
    )
    assert loaded.pack() == model.pack()


def test_byte_counts_are_those_of_the_file(model: SPMM) -> None:
    counts = model.byte_counts()
    assert counts["total"] == len(model.pack())
    parts = sum(counts[name] for name in ("weights", "dictionary", "residual"))
    assert 0 < parts < counts["total"]
    function = len(VIEW) * len(LIGHT) * 3
    expected = len(model.residual.code) * (2 * function + 4)
    if model.components is not None:
        expected += model.components.rank * (function + 4 * len(VIEW) + HEIGHT * WIDTH + 4)
    assert counts["residual"] == expected


def test_files_with_parts_missing(tmp_path: Path, model: SPMM) -> None:
    tensors, metadata = model.to_tensors()
    path = tmp_path / "x.safetensors"
    lacking = {name: tensor for name, tensor in tensors.items() if name != "weights.index"}
    renamed = {**metadata, "models": metadata["models"].replace("ward", "drawn")}
    for content in (tensor_file.pack(lacking, metadata), tensor_file.pack(tensors, renamed)):
        path.write_bytes(content)
        with pytest.raises(OutputError, match=r"x.safetensors lacks a part"):
            SPMM.load(path)


def test_a_file_of_version_1_is_read_and_stays_as_it_is() -> None:
    """Written by a program that knew no other version; values are those that it gave."""
    old = Path(__file__).parent / "version_1.safetensors"
    model = SPMM.load(old)
    assert (model.components, model.weight_type) == (None, torch.float32)
    assert model.pack() == old.read_bytes()
    picture = model.picture(model.light[2], model.view[5])
    torch.testing.assert_close(picture.mean(), torch.tensor(0.2878566), rtol=1e-5, atol=0.0)
    wi, wo = torch.tensor([0.36, 0.48, 0.8]), torch.tensor([-0.6, 0.0, 0.8])
    expected = torch.tensor([0.3479057, 0.1607914, 0.0991609])
    torch.testing.assert_close(model(torch.tensor([0.3, 0.6]), wi, wo), expected, rtol=1e-4, atol=0)


@pytest.mark.gpu
def test_same_on_cuda(tmp_path: Path, model: SPMM) -> None:
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(model.pack())
    on_gpu = SPMM.load(tmp_path, "cuda")
    uv, wi, wo = all_centres() + 0.03, directions(12, 1), directions(12, 2)
    found = on_gpu(uv.cuda(), wi.cuda(), wo.cuda())
    assert found.is_cuda
    torch.testing.assert_close(found.cpu(), model(uv, wi, wo), rtol=1e-4, atol=1e-5)
    moved = model.to("cuda").picture(wi[0].cuda(), wo[0].cuda())
    torch.testing.assert_close(moved, on_gpu.picture(wi[0].cuda(), wo[0].cuda()))
    assert on_gpu.pack() == SPMM.load(tmp_path).pack()


def test_samples_estimate_what_the_model_reflects(model: SPMM) -> None:
    """The mean of rgb / pdf is the integral over the hemisphere, at texels and between them."""
    generator = torch.Generator().manual_seed(3)
    count = 40_000
    wo = direction_from_angles(torch.tensor(0.6), torch.tensor(1.0))
    for uv in (centre(2), torch.tensor([0.43, 0.61])):
        wi, rgb, density = model.sample(uv, wo, torch.rand(count, 3, generator=generator))
        assert float(wi[:, 2].min()) >= 0.0
        assert torch.equal(rgb, model(uv, wi, wo))
        torch.testing.assert_close(density, model.pdf(uv, wi, wo))
        estimate = (rgb / density[:, None]).mean(0)
        spread = (rgb / density[:, None]).std(0) / math.sqrt(count)
        uniform = directions_on_hemisphere(400_000, generator)
        values = 2.0 * math.pi * model(uv, uniform, wo)
        error = (spread.square() + values.var(0) / len(values)).sqrt()
        assert ((estimate - values.mean(0)).abs() < 4.5 * error).all()


def test_the_density_integrates_to_one(model: SPMM) -> None:
    """Over cells of equal solid angle, at texels with and without lobes and between them."""
    steps = (torch.arange(256) + 0.5) / 256
    cosine, turn = torch.meshgrid(steps, steps, indexing="ij")
    wi = direction_from_angles(torch.arccos(cosine), 2.0 * math.pi * turn).flatten(0, 1)
    wo = direction_from_angles(torch.tensor(0.6), torch.tensor(1.0))
    for uv in (centre(2), centre(5), torch.tensor([0.43, 0.61])):
        assert float(2.0 * math.pi * model.pdf(uv, wi, wo).mean()) == pytest.approx(1.0, abs=0.01)


def test_the_cosine_lobe_is_likelier_the_larger_the_residual() -> None:
    small, large = (with_components(build(), size=size).sampling_data() for size in (0.01, 1.0))
    assert bool((large.group <= small.group).all())
    assert bool((large.group < small.group).any())


def directions_on_hemisphere(count: int, generator: torch.Generator) -> Tensor:
    u = torch.rand(count, 2, generator=generator)
    return direction_from_angles(torch.arccos(u[:, 0]), 2.0 * math.pi * u[:, 1])


def test_sampling_shapes(model: SPMM) -> None:
    wo = directions(5, 1)
    wi, rgb, density = model.sample(centre(3), wo[None], torch.rand(2, 5, 3))
    assert (wi.shape, rgb.shape, density.shape) == ((2, 5, 3), (2, 5, 3), (2, 5))
    assert model.pdf(centre(3), torch.tensor([0.0, 0.0, -1.0]), wo[0]).item() == 0.0


def test_precision_of_the_process_does_not_reach_in(model: SPMM) -> None:
    """Directions rounded to bfloat16, as programs that train networks ask for, miss lobes."""
    wi, wo, uv = directions(1, 1), directions(1, 2), all_centres()
    u = torch.rand(len(uv), 3, generator=torch.Generator().manual_seed(0))
    expected = torch.cat([direct(model, texel, wi, wo) for texel in range(HEIGHT * WIDTH)])
    pairs = directions(64, 1), directions(64, 2)
    sampled, density = model.sample(uv, wo, u), model.pdf(centre(2), *pairs)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        for found in (model(uv, wi, wo), model.picture(wi[0], wo[0]).flatten(0, 1)):
            torch.testing.assert_close(found, expected, rtol=1e-5, atol=2e-6)
        assert all(map(torch.equal, model.sample(uv, wo, u), sampled))
        assert torch.equal(model.pdf(centre(2), *pairs), density)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(model: SPMM, dtype: torch.dtype) -> None:
    wi, wo = directions(4, 1).to(dtype), directions(4, 2).to(dtype)
    with pytest.raises(DataError, match="expected float32 or float64"):
        model(torch.rand(4, 2), wi, wo)


@pytest.mark.parametrize(
    "change",
    [
        {"height": "-8"},
        {"height": "4"},
        {"weights.index": 200},
        {"weights.label": 100},
        {"weights.count": 9},
    ],
)
def test_a_file_whose_parts_do_not_fit_each_other_is_refused(
    tmp_path: Path, change: dict[str, str | int]
) -> None:
    """Not met as an error of a tensor, or a wrong texel, by whoever looks one up."""
    tensors, metadata = build().to_tensors()
    ((name, value),) = change.items()
    if isinstance(value, str):
        metadata[name] = value
    else:
        tensors[name] = tensors[name].clone()
        tensors[name][-1] = value
    (tmp_path / "model.safetensors").write_bytes(tensor_file.pack(tensors, metadata))
    with pytest.raises(OutputError, match="lacks a part of the model"):
        SPMM.load(tmp_path)

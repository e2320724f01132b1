"""What an evaluation says of the report of the fit."""

from __future__ import annotations

from spmm_torch.evaluate.judge import report_difference


def test_figures_that_are_rounding_are_no_difference() -> None:
    """A bare mean of one texel a cluster is exact, up to the rounding of its values."""

    def figures(whole: float, means: float) -> dict[str, dict[str, float]]:
        return {"psnr_db": {}, "snr_db": {"with_residual": whole, "cluster_mean": means}}

    assert report_difference(figures(40.0, 166.5), figures(40.25, 161.5)) == 0.25
    assert report_difference(figures(40.0, 166.5), figures(40.0, 61.5)) == 105.0
    assert report_difference(figures(130.0, 166.5), figures(140.0, 161.5)) is None

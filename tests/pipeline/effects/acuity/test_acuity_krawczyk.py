"""Krawczyk's blur from a stack of frames, against closed forms and the true filter."""

import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline.effects.acuity import Acuity, AcuityMethod, krawczyk, larson, reduce_acuity
from entoptic.pipeline.oracles import acuity as oracle

KRAWCZYK = Acuity(AcuityMethod.KRAWCZYK)
TRUE = Acuity(AcuityMethod.KRAWCZYK, reference=True)


def grey(y: np.ndarray) -> np.ndarray:
    return np.broadcast_to(y, (1, 3, *y.shape)).astype(np.float32)


def ppd_of(sigma_px: float, y_cd_m2: float) -> float:
    """Pixels per degree at which a luminance is blurred by this σ."""
    return float(np.sqrt(sigma_px**2 + larson.display_px2(True)) * 1.86 * larson.resolved_cpd(y_cd_m2))


@pytest.mark.parametrize(("sigma", "within"), [(1.0, 0.03), (8.0, 0.1), (3.3, 0.1)])
def test_a_faint_point_becomes_a_gaussian(sigma: float, within: float) -> None:
    # So faint that σ is the same everywhere; 3.3 px lies midway between two rungs; at 8 px the frame is halved twice.
    y = np.full((95, 96), 1e-4)
    y[47, 47] *= 1.02
    after = np.asarray(reduce_acuity(jnp.asarray(grey(y)), ppd_of(sigma, 1e-4), KRAWCZYK), np.float64)[0, 1]
    distance = np.hypot(*(np.mgrid[:95, :96] - 47))
    closed = 2e-6 * np.exp(-(distance**2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)
    assert after - 1e-4 == pytest.approx(closed, abs=within * closed.max() + 1e-11)


def scene(kind: str) -> np.ndarray:
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:70, :83]
    match kind:
        case "noise":
            return 10 ** rng.uniform(-5, -1, rows.shape)
        case "edge":
            return np.where(columns < 40, 1e-4, 5e-3)
        case "points":
            return np.where(rng.random(rows.shape) < 0.003, 0.5, 1e-5)
        case _:
            return 10 ** (-5 + 4 * columns / 83) * (1 + 0.5 * np.sin(rows / 3))


@pytest.mark.parametrize("ppd", [9.82, 25.0])
@pytest.mark.parametrize(("kind", "within"), [("noise", 0.09), ("edge", 0.04), ("points", 0.15), ("ramp", 0.1)])
def test_it_does_what_the_true_filter_does(kind: str, within: float, ppd: float) -> None:
    frame = grey(scene(kind))
    ours = np.asarray(reduce_acuity(jnp.asarray(frame), ppd, KRAWCZYK), np.float64) - frame
    true = oracle.reference_acuity(frame, ppd, TRUE) - frame
    assert np.linalg.norm(ours - true) <= within * np.linalg.norm(true)


def test_the_fit_is_the_true_filter_where_a_frame_varies_one_way() -> None:
    # Both directions' widths are then one pixel's own; the truth's kernel goes on to 4σ.
    y = np.broadcast_to(np.linspace(1e-4, 0.08, 60) * (1 + 0.5 * np.sin(np.arange(60))), (20, 60))
    ours = np.asarray(reduce_acuity(jnp.asarray(grey(y)), 9.82), np.float64)[:, :, :, 5:-5]
    true = np.asarray(reduce_acuity(jnp.asarray(grey(y)), 9.82, Acuity(reference=True)), np.float64)[:, :, :, 5:-5]
    assert np.abs(ours - true).max() < 0.01 * np.abs(true - grey(y)[:, :, :, 5:-5]).max()


def test_brighter_than_the_limit_nothing_changes() -> None:
    limit = larson.limit_cd_m2(20.0, True)
    y = np.random.default_rng(5).uniform(limit * 1.001, limit * 50, (30, 31))
    assert (np.asarray(reduce_acuity(jnp.asarray(grey(y)), 20.0, KRAWCZYK)) == grey(y)).all()


def test_blur_sets_in_smoothly_below_the_limit() -> None:
    limit = larson.limit_cd_m2(20.0, True)
    ripple = 1 + 0.3 * np.where(np.indices((40, 40)).sum(0) % 2, 1, -1)
    contrasts = []
    for factor in np.linspace(0.6, 0.9, 16):
        after = np.asarray(reduce_acuity(jnp.asarray(grey(ripple * limit * factor / 1.3)), 20.0, KRAWCZYK))[0, 1]
        contrasts.append(after.std() / after.mean())
    assert contrasts[0] < 0.7 * 0.3
    assert np.abs(np.diff(contrasts)).max() < 0.06


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (17, 5)])
def test_kernels_larger_than_the_frame_leave_its_range(shape: tuple[int, int]) -> None:
    y = np.random.default_rng(6).uniform(1e-6, 1e-3, shape)
    after = np.asarray(reduce_acuity(jnp.asarray(grey(y)), 200.0, KRAWCZYK))[0, 1]
    assert after.min() >= y.min() * (1 - 1e-5)
    assert after.max() <= y.max() * (1 + 1e-5)
    if min(shape) > 1:
        assert np.ptp(after) < 0.1 * np.ptp(y)


@pytest.mark.parametrize("sigma", [0.4, 1.9, 6.0])
def test_light_stays_within_reach(sigma: float) -> None:
    reach = krawczyk.reach_px(sigma**2)
    assert reach >= 2 * sigma
    y = np.full((1, 2 * reach + 60), 1e-4)
    y[0, reach + 30] = 0.1
    y = np.repeat(y, 3, 0)
    after = np.asarray(reduce_acuity(jnp.asarray(grey(y)), ppd_of(sigma, 1e-4), KRAWCZYK))[0, 1]
    far = np.abs(np.arange(y.shape[1]) - reach - 30) > reach
    assert after[:, far] == pytest.approx(y[:, far], rel=1e-5)


def test_both_eyes_are_blurred_each_by_itself() -> None:
    left, right = grey(scene("edge")), grey(scene("noise"))
    both = np.asarray(reduce_acuity(jnp.asarray(np.concatenate([left, right])), 12.0, KRAWCZYK))
    for eye, frame in enumerate((left, right)):
        assert both[eye] == pytest.approx(
            np.asarray(reduce_acuity(jnp.asarray(frame), 12.0, KRAWCZYK))[0], rel=1e-4, abs=1e-8
        )

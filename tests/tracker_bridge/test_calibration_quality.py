"""What is made of a run: diameters that are right, and each named failure from the eyes or display that cause it."""

import math
from collections.abc import Callable, Iterator

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from entoptic.tracker_bridge.calibration import Protocol, Screen, ShownScreen, Stage, luidolt, robust
from entoptic.tracker_bridge.calibration_quality import REMEDIES, Analysis, Failure, analyse
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, PupilSample
from entoptic.tracker_bridge.sources.simulated.pupil import watson_yellott_mm

RATE_HZ = 60
FIGURES = {Screen.WHITE: 3.0, Screen.BLACK: 6.5}


def shown(protocol: Protocol) -> tuple[ShownScreen, ...]:
    screens, t_s = [], 0.0
    for step in protocol.steps:
        screens.append(ShownScreen(step.screen, round(t_s * NS_PER_S), step.seconds, step.use_last_s))
        t_s += step.seconds
    return tuple(screens)


def eye_before(
    protocol: Protocol, eye: Eye, settled_mm: Callable[[Screen], float] = FIGURES.__getitem__
) -> Iterator[PupilSample]:
    """A quiet pupil that follows each screen with a time constant of 0.6 s."""
    pupil_diameter_mm = 4.0
    for screen in shown(protocol):
        for k in range(round(screen.seconds * RATE_HZ)):
            pupil_diameter_mm += (settled_mm(screen.screen) - pupil_diameter_mm) / (0.6 * RATE_HZ)
            yield PupilSample(screen.t_ns + k * NS_PER_S // RATE_HZ, eye, pupil_diameter_mm, 1.0)


def both(change: Callable[[PupilSample], PupilSample | None] = lambda sample: sample) -> Analysis:
    samples = [sample for eye in Eye for sample in eye_before(robust(), eye)]
    changed = [one for sample in samples if (one := change(sample)) is not None]
    return analyse(changed, shown(robust()), robust())


def failures(analysis: Analysis) -> set[Failure]:
    return {problem.failure for problem in analysis.problems}


def in_px(sample: PupilSample, px_per_mm: float = 23.0) -> PupilSample:
    assert sample.pupil_diameter_mm is not None
    return msgspec.structs.replace(sample, pupil_diameter_mm=None, diameter_px=sample.pupil_diameter_mm * px_per_mm)


def scaled(sample: PupilSample, factor: float) -> PupilSample:
    assert sample.pupil_diameter_mm is not None
    return msgspec.structs.replace(sample, pupil_diameter_mm=sample.pupil_diameter_mm * factor)


def test_quiet_eyes_are_measured_and_accepted() -> None:
    analysis = both()
    assert analysis.problems == ()
    for eye in Eye:
        assert analysis.eyes[eye].of(Screen.WHITE) == pytest.approx(3.0, abs=0.01)
        assert analysis.eyes[eye].of(Screen.BLACK) == pytest.approx(6.5, abs=0.001)
        assert [window.valid_share for window in analysis.eyes[eye].windows] == pytest.approx([1.0] * 3)


def test_pixels_are_measured_in_pixels() -> None:
    analysis = both(in_px)
    assert analysis.problems == ()
    assert analysis.eyes[Eye.LEFT].trace.unit == "px"
    assert analysis.eyes[Eye.LEFT].of(Screen.WHITE) == pytest.approx(3.0 * 23, rel=0.003)
    assert analysis.eyes[Eye.LEFT].of(Screen.BLACK) == pytest.approx(6.5 * 23, rel=0.001)


@settings(max_examples=4)
@given(st.floats(0.5, 500.0))
def test_the_scale_of_pixels_does_not_matter(px_per_mm: float) -> None:
    samples = [in_px(sample, px_per_mm) for sample in eye_before(robust(), Eye.LEFT)]
    analysis = analyse(samples, shown(robust()), robust())
    assert analysis.problems == ()
    result = analysis.eyes[Eye.LEFT]
    assert result.of(Screen.BLACK) / result.of(Screen.WHITE) == pytest.approx(6.5 / 3.0, rel=0.003)


def test_blinks_do_not_change_the_result() -> None:
    """A lid every 3 s that shrinks the pupil for 80 ms at good confidence, then hides it for 150 ms."""

    def blink(sample: PupilSample) -> PupilSample:
        since_s = sample.t_ns / NS_PER_S % 3.0
        if since_s < 0.08:
            return scaled(sample, 1.0 - since_s / 0.1)
        return msgspec.structs.replace(sample, pupil_diameter_mm=-0.07, confidence=0.0) if since_s < 0.23 else sample

    analysis = both(blink)
    assert analysis.problems == ()
    assert analysis.eyes[Eye.RIGHT].of(Screen.BLACK) == pytest.approx(6.5, abs=0.005)
    assert analysis.eyes[Eye.RIGHT].of(Screen.WHITE) == pytest.approx(3.0, abs=0.02)


def test_what_comes_late_twice_or_backwards_is_left_out() -> None:
    samples = list(eye_before(robust(), Eye.LEFT))
    muddled = [
        one for k, sample in enumerate(samples) for one in ([sample, samples[k // 2]] if k % 7 == 0 else [sample])
    ]
    protocol = robust()
    assert analyse(muddled, shown(protocol), protocol).eyes[Eye.LEFT].windows == (
        analyse(samples, shown(protocol), protocol).eyes[Eye.LEFT].windows
    )


def test_closed_eyes_are_too_few_samples() -> None:
    analysis = both(
        lambda sample: msgspec.structs.replace(sample, confidence=0.0) if sample.t_ns > 24 * NS_PER_S else sample
    )
    assert failures(analysis) == {Failure.TOO_FEW_SAMPLES}
    assert "black: the pupil was tracked for 2.0 of 4 s (50%; 60% are needed)" in analysis.problems[0].detail


def test_a_silent_tracker_is_too_few_samples() -> None:
    assert failures(both(lambda sample: None if sample.t_ns > 24 * NS_PER_S else sample)) == {Failure.TOO_FEW_SAMPLES}
    assert failures(both(lambda sample: None)) == {Failure.TOO_FEW_SAMPLES}


def test_one_lost_eye_fails_unless_it_is_left_out() -> None:
    protocol = robust()
    samples = [*eye_before(protocol, Eye.LEFT)]
    samples += [msgspec.structs.replace(sample, eye=Eye.RIGHT, confidence=0.1) for sample in samples]
    (problem,) = analyse(samples, shown(protocol), protocol).problems
    assert (problem.failure, problem.eye) == (Failure.TOO_FEW_SAMPLES, Eye.RIGHT)
    assert analyse(samples, shown(protocol), protocol, eyes=(Eye.LEFT,)).problems == ()


def test_a_tracker_of_one_eye_is_enough() -> None:
    protocol = robust()
    analysis = analyse(eye_before(protocol, Eye.LEFT), shown(protocol), protocol)
    assert (analysis.problems, set(analysis.eyes)) == ((), {Eye.LEFT})


@pytest.mark.parametrize("protocol", [robust(), luidolt()], ids=lambda protocol: protocol.name)
def test_a_pupil_that_does_not_answer_has_no_span(protocol: Protocol) -> None:
    samples = eye_before(protocol, Eye.LEFT, lambda screen: 4.0 if screen is Screen.WHITE else 4.6)
    assert failures(analyse(samples, shown(protocol), protocol)) == {Failure.NO_SPAN}


@pytest.mark.parametrize("protocol", [robust(), luidolt()], ids=lambda protocol: protocol.name)
def test_screens_that_are_swapped_are_inverted(protocol: Protocol) -> None:
    samples = list(eye_before(protocol, Eye.LEFT, lambda screen: 9.5 - FIGURES[screen]))
    assert failures(analyse(samples, shown(protocol), protocol)) == {Failure.INVERTED}
    assert failures(analyse(map(in_px, samples), shown(protocol), protocol)) == {Failure.INVERTED}


def test_a_pupil_that_still_moves_is_drifting() -> None:
    analysis = both(lambda sample: scaled(sample, 1.0 + 0.03 * math.sin(sample.t_ns / NS_PER_S * 1.3)))
    assert failures(analysis) == {Failure.DRIFTING}


def test_whites_that_differ_are_drifting() -> None:
    analysis = both(lambda sample: scaled(sample, 1.12) if sample.t_ns > 26 * NS_PER_S else sample)
    assert failures(analysis) == {Failure.DRIFTING}
    assert "the white screens differ by 0.3" in analysis.problems[0].detail


@pytest.mark.parametrize("unit", ["mm", "px"])
def test_an_eye_that_opens_less_than_the_other_disagrees(unit: str) -> None:
    protocol = robust()
    samples = list(eye_before(protocol, Eye.LEFT))
    samples += eye_before(protocol, Eye.RIGHT, lambda screen: 3.2 if screen is Screen.WHITE else 4.9)
    analysis = analyse(map(in_px, samples) if unit == "px" else samples, shown(protocol), protocol)
    assert failures(analysis) == {Failure.EYES_DISAGREE}
    assert "span" in analysis.problems[0].detail


def test_eye_cameras_of_different_scale_agree_in_pixels_and_not_in_millimetres() -> None:
    assert failures(both(lambda sample: scaled(sample, 1.0 + 0.25 * sample.eye))) == {Failure.EYES_DISAGREE}
    assert both(lambda sample: in_px(sample, 20.0 + 5.0 * sample.eye)).problems == ()


@pytest.mark.parametrize(("stage", "failure"), [(Stage.NOT_SHOWN, Failure.NOT_SHOWN), (Stage.ABORTED, Failure.ABORTED)])
def test_a_run_that_did_not_end_says_so_and_nothing_else(stage: Stage, failure: Failure) -> None:
    protocol = robust()
    analysis = analyse(eye_before(protocol, Eye.LEFT), shown(protocol)[:1], protocol, stage)
    assert failures(analysis) == {failure}
    assert len(analysis.eyes[Eye.LEFT].windows) == 1


def test_every_failure_has_a_remedy() -> None:
    assert set(REMEDIES) == set(Failure)


def test_a_span_of_old_age_is_enough() -> None:
    """Watson & Yellott's formula ends at 83 years."""
    lights = {Screen.WHITE: 200.0, Screen.BLACK: 0.05}
    old = {screen: watson_yellott_mm(light, 900.0, 83.0) for screen, light in lights.items()}
    assert old[Screen.BLACK] - old[Screen.WHITE] > 1.5
    samples = list(eye_before(robust(), Eye.LEFT, old.__getitem__))
    assert analyse(samples, shown(robust()), robust()).problems == ()
    assert analyse(map(in_px, samples), shown(robust()), robust()).problems == ()


def test_noise_alone_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    noisy = [scaled(sample, 1.0 + 0.01 * rng.normal()) for eye in Eye for sample in eye_before(robust(), eye)]
    analysis = analyse(noisy, shown(robust()), robust())
    assert analysis.problems == ()
    assert analysis.eyes[Eye.LEFT].of(Screen.BLACK) == pytest.approx(6.5, abs=0.02)

"""What holds of every effect: each is looked up in EFFECTS and nowhere named."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from entoptic.pipeline import (
    EFFECTS,
    Display,
    Effect,
    Effects,
    EyeContext,
    EyePose,
    Frame,
    Observer,
    Planning,
    perceive,
)
from entoptic.pipeline.effects.effect import SKIPPED, Picture, TileChanges, TileRanges
from entoptic.pipeline.measure import luminance, measure
from entoptic.pipeline.ranges import Change, Range
from entoptic.pipeline.viewing import prepare, view_frame

OBSERVER = Observer(particles=100, gratings=20, cornea_cells=300, vitreous_particles=20)
SIDE = 64
CASES = [
    pytest.param(effect, settings, id=f"{effect.name} {name}")
    for effect in EFFECTS
    for name, settings in effect.variants().items()
]
OPTIONAL = [case for case in CASES if case.values[0].optional]


def frames() -> Iterator[Frame]:
    """A dark one with a lamp, an even one, one of all luminances; coarse and fine."""
    random = np.random.default_rng(11)
    dark = np.full((SIDE, SIDE, 3), 3e-3) * random.uniform(0.5, 1.5, (SIDE, SIDE, 1))
    dark[20, 30] = (300.0, 200.0, 50.0)
    yield Frame.from_rgb(dark, 40.0)
    yield Frame.from_rgb(np.full((SIDE, SIDE, 3), 0.05), 40.0)
    coarse = 10 ** random.uniform(-4, 2, (8, 8, 3))
    yield Frame.from_rgb(coarse.repeat(8, 0).repeat(8, 1), 40.0)


def eye_of(frame: Frame, effects: Effects) -> EyeContext:
    """An eye that viewed a bright frame for ten seconds, and this one since a moment."""
    bright = Frame.from_rgb(np.full((SIDE, SIDE, 3), 2e4) * np.linspace(0, 1, SIDE)[:, None, None], 40.0)
    pose = EyePose(3.0, -2.0, 5.0)
    before = None
    for shown, dt_s in ((bright, 0.0), (bright, 10.0), (frame, 0.2)):
        viewing = view_frame(shown, measure(shown), (pose,), OBSERVER, Display(), effects, before, dt_s)
        before = viewing.state
    return prepare(viewing.eyes)[0]


@functools.cache
def before_effect(effect: Effect, settings: msgspec.Struct, k: int) -> tuple[EyeContext, Picture]:
    """An eye, and the picture as the effects before this one leave it in full."""
    frame = list(frames())[k]
    effects = Effects(**{effect.name: settings})
    eye = eye_of(frame, effects)
    picture = Picture(frame.rgb_cd_m2, frame.rgb_cd_m2)
    for one in EFFECTS[: EFFECTS.index(effect)]:
        of = one.settings_of(effects)
        if one.is_on(of):
            picture = picture.after(one.apply(picture, [eye], of, one.full_level(of), None), one.domain)
    return eye, picture


def channels(image: object) -> np.ndarray:
    """Red, green, blue and luminance of one eye's image."""
    rgb = np.asarray(image, np.float64)[0]
    return np.concatenate([rgb, np.asarray(luminance(rgb))[None]])


def by_tile(values: np.ndarray, tile_px: int, fold: np.ufunc) -> np.ndarray:
    for axis in (1, 2):
        values = fold.reduceat(values, range(0, values.shape[axis], tile_px), axis=axis)
    return values


def range_of(image: object, tile_px: int) -> Range:
    values = np.maximum(channels(image), 0)
    return Range(by_tile(values, tile_px, np.minimum), by_tile(values, tile_px, np.maximum), tile_px)


def ranges_of(picture: Picture, tile_px: int) -> TileRanges:
    return TileRanges(range_of(picture.image, tile_px), range_of(picture.scene, tile_px))


def change_of(one: object, other: object, tile_px: int) -> Change:
    return by_tile(np.abs(channels(one) - channels(other)), tile_px, np.maximum)


def within(change: Change, bound: Change, image: object) -> None:
    rounding = 2e-6 * float(np.abs(channels(image)).max()) + 2e-7
    assert (change <= bound * (1 + 1e-4) + rounding).all(), float((change - bound).max())


@pytest.mark.parametrize(("effect", "settings"), OPTIONAL)
@pytest.mark.parametrize("k", range(3))
def test_no_reduced_level_changes_a_tile_by_more_than_its_bound(
    effect: Effect, settings: msgspec.Struct, k: int
) -> None:
    eye, picture = before_effect(effect, settings, k)
    tile_px = eye.measured.range_cd_m2.tile_px
    full = effect.apply(picture, [eye], settings, effect.full_level(settings), None)
    for level in effect.reduced_levels(settings):
        reduced = picture.image if level == SKIPPED else effect.apply(picture, [eye], settings, level, None)
        bound = effect.bound(ranges_of(picture, tile_px), eye, settings, level)
        within(change_of(full, reduced, tile_px), bound, picture.image)
        assert np.isfinite(bound).all()


@pytest.mark.parametrize(("effect", "settings"), CASES)
@pytest.mark.parametrize("k", range(3))
def test_no_change_before_it_comes_out_larger_than_it_says(effect: Effect, settings: msgspec.Struct, k: int) -> None:
    eye, picture = before_effect(effect, settings, k)
    tile_px = eye.measured.range_cd_m2.tile_px
    random = np.random.default_rng(k)
    factor = jnp.asarray(1 + 0.05 * random.uniform(-1, 1, (1, 1, SIDE, SIDE)), jnp.float32)
    moved = Picture(picture.image * factor, picture.scene * factor)
    changes = TileChanges(
        change_of(picture.image, moved.image, tile_px), change_of(picture.scene, moved.scene, tile_px)
    )
    level = effect.full_level(settings)
    one, other = (effect.apply(each, [eye], settings, level, None) for each in (picture, moved))
    within(change_of(one, other, tile_px), effect.propagate(changes, ranges_of(picture, tile_px), eye, settings), one)


@pytest.mark.parametrize(("effect", "settings"), CASES)
@pytest.mark.parametrize("k", range(3))
def test_what_may_stand_behind_it_holds_what_does(effect: Effect, settings: msgspec.Struct, k: int) -> None:
    eye, picture = before_effect(effect, settings, k)
    tile_px = eye.measured.range_cd_m2.tile_px
    ranges = ranges_of(picture, tile_px)
    hidden = effect.bound(ranges, eye, settings, SKIPPED) if effect.optional else np.zeros_like(ranges.image.low)
    stands = effect.ranges_after(ranges, hidden, eye, settings)
    image = effect.apply(picture, [eye], settings, effect.full_level(settings), None)
    seen = range_of(image, tile_px)
    rounding = 2e-6 * seen.high.max() + 2e-7
    assert (seen.low >= stands.low * (1 - 1e-4) - rounding).all()
    assert (seen.high <= stands.high * (1 + 1e-4) + rounding).all()


@functools.cache
def truth(effect: Effect, settings: msgspec.Struct, k: int) -> np.ndarray:
    """What the oracle makes of a frame."""
    eye, picture = before_effect(effect, settings, k)
    return effect.oracle(picture, eye, settings)


@pytest.mark.parametrize(("effect", "settings"), CASES)
def test_float32_is_the_oracle_within_what_is_stated(effect: Effect, settings: msgspec.Struct) -> None:
    for k in range(3):
        eye, picture = before_effect(effect, settings, k)
        image = np.asarray(effect.apply(picture, [eye], settings, effect.full_level(settings), None), np.float64)[0]
        expected = truth(effect, effect.truth_of(settings), k)
        scale = float(np.quantile(np.abs(expected), 0.99))
        off = np.abs(image - expected) / (np.abs(expected) + scale)
        assert np.quantile(off, 0.99) <= effect.accuracy(settings), (k, float(np.quantile(off, 0.99)), float(off.max()))


@pytest.mark.parametrize("planning", [Planning(), Planning(everything=True), Planning(budget_ms=1.0)])
@pytest.mark.parametrize("k", range(3))
def test_what_the_plan_says_runs_is_drawn_and_nothing_else(
    planning: Planning, k: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[str, str]] = []
    for effect in EFFECTS:

        def noted(*arguments: object, of: Effect = effect, plainly: Callable[..., object]) -> object:
            """An effect runs by itself, which may be one pass of its own, or in a pass with its neighbours."""
            made = plainly(*arguments)
            if made is not None and (of.name, str(arguments[3])) not in drawn:
                drawn.append((of.name, str(arguments[3])))
            return made

        for way in ("apply", "pointwise"):
            monkeypatch.setattr(effect, way, functools.partial(noted, plainly=getattr(effect, way)))
    effects = Effects(
        **{effect.name: next(iter(effect.variants().values())) for effect in EFFECTS if effect.name != "tone"}
    )
    seen = perceive(
        list(frames())[k], EyePose(pupil_diameter_mm=5.0), observer=OBSERVER, effects=effects, planning=planning
    )
    said = [(step.effect, level) for step in seen.plan for level in step.weights if step.runs and level != SKIPPED]
    assert drawn == said
    assert [step.effect for step in seen.plan] == [effect.name for effect in EFFECTS]
    assert {step.effect for step in seen.plan if step.runs} == set(seen.milliseconds) & {e.name for e in EFFECTS}


@pytest.mark.parametrize(("effect", "settings"), OPTIONAL)
def test_leaving_it_out_gives_the_picture_without_it(effect: Effect, settings: msgspec.Struct) -> None:
    """And the plan says so, with a reason; switched off in the settings it is not called skipped."""
    frame = next(frames())
    without = perceive(
        frame,
        EyePose(pupil_diameter_mm=5.0),
        observer=OBSERVER,
        effects=Effects(**{effect.name: settings}),
        planning=Planning(everything=True, leave_out=frozenset({effect.name})),
    )
    step = without.plan[effect.name]
    assert (step.level, step.reason, step.runs) == (SKIPPED, "left out as asked", False)
    assert effect.name not in without.milliseconds


@pytest.mark.parametrize(("effect", "settings"), OPTIONAL)
def test_its_reason_has_the_figures_that_decide(effect: Effect, settings: msgspec.Struct) -> None:
    """Of a frame that is dark and of one that is not, the reasons differ, or it is a matter of memory."""
    reasons = {effect.reason(eye_of(frame, Effects(**{effect.name: settings})), settings) for frame in frames()}
    assert all(reasons)
    assert len(reasons) > 1 or effect.Memory is not None


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_its_record_is_complete(effect: Effect) -> None:
    assert effect.Settings().__struct_config__.frozen
    assert effect.Settings().__struct_config__.forbid_unknown_fields
    default = effect.full_level(effect.Settings())
    assert default in effect.costs
    assert inspect.getdoc(type(effect))
    for level in effect.reduced_levels(effect.Settings()):
        assert level == SKIPPED or level in effect.costs


def concrete(effect: Effect) -> list[str]:
    return sorted(name for name, member in inspect.getmembers(Effect) if getattr(member, "__isabstractmethod__", False))


@pytest.mark.parametrize("method", concrete(EFFECTS[0]))
def test_an_effect_without_one_of_its_methods_cannot_be_made(method: str) -> None:
    """mypy says so where it is made, and Python does at the latest."""
    methods = {name: (lambda self: None) for name in concrete(EFFECTS[0]) if name != method}
    with pytest.raises(TypeError, match=method):
        type("Forgetful", (Effect,), methods)()


def test_eyes_of_a_frame_are_told_apart() -> None:
    """An effect is given all eyes at once: each image its own."""
    one = next(frames())
    both = dataclasses.replace(one, rgb_cd_m2=jnp.concatenate([one.rgb_cd_m2, one.rgb_cd_m2 * 10]))
    poses = (EyePose(2.0, 1.0, 4.0), EyePose(-2.0, 1.0, 7.0))
    seen = perceive(both, poses, observer=OBSERVER, planning=Planning(everything=True))
    for k, pose in enumerate(poses):
        alone = dataclasses.replace(one, rgb_cd_m2=both.rgb_cd_m2[k : k + 1])
        image = perceive(alone, pose, observer=OBSERVER, planning=Planning(everything=True)).image
        assert np.abs(seen.image[k].astype(int) - image[0].astype(int)).max() <= 1

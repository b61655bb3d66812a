"""Pupils calibrated inside a live bridge's loop, on real sockets, before a display program with its own clock."""

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
import zmq
from screen_program import ScreenProgram

from entoptic.services import keys as key_files
from entoptic.services.calibration.display import READY_WORDS, SocketDisplay
from entoptic.services.calibration.pupil_calibration import WORKING_OUT, PupilCalibration
from entoptic.services.calibration.run import Room
from entoptic.services.ipc.requests import CalibratePupils
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.access import OpenAddressError
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.pupil_map import PupilMap
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, EyeState, Phase, PupilSample
from entoptic.tracker_bridge.source import Item, Tick
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.live import LiveEyes

ANY = "tcp://127.0.0.1:*"
PATIENCE_S = 60.0
SCENE_CD_M2 = 10.0
QUICK = {"protocol": "luidolt", "white_s": 2.0, "black_s": 2.0}  # black comes first


def px_at(cd_m2: float) -> float:
    return 100.0 - 20.0 * math.log10(cd_m2)


class PromptEyes:
    """Pupils that follow the light faster than any, before a tracker that measures pixels: screens can be short."""

    def __init__(self) -> None:
        self.lights: list[float] = [SCENE_CD_M2]

    def set_luminance(self, luminance_cd_m2: float, t_ns: int) -> None:
        self.lights.append(luminance_cd_m2)

    def samples(self) -> Iterator[Item]:
        px, before_ns = px_at(SCENE_CD_M2), time.monotonic_ns()
        while True:
            now_ns = time.monotonic_ns()
            px += (px_at(self.lights[-1]) - px) * (1 - math.exp((before_ns - now_ns) / (0.3 * NS_PER_S)))
            before_ns = now_ns
            for eye in Eye:
                yield PupilSample(now_ns, eye, None, 1.0, 1.0, px, 1.0)
            yield Tick(now_ns)
            time.sleep(0.01)


class BridgeLoop:
    """What a live bridge does with its source, its chain and a calibration."""

    def __init__(self, calibration: PupilCalibration, eyes: PromptEyes | LiveEyes) -> None:
        self.calibration = calibration
        self.chain = Chain(live=True)
        self.maps: list[PupilMap] = []
        self.states: list[EyeState] = []
        self.diameters_mm: list[float] = []
        """As measured."""
        self.stages: list[str] = []
        self.without_map = 0
        """States until a map was there."""
        self.worst_step_ns = 0
        self._items = eyes.samples()

    def until(self, condition: Callable[[], object]) -> None:
        give_up = time.monotonic() + PATIENCE_S
        for item in self._items:
            if isinstance(item, PupilSample) and item.pupil_diameter_mm is not None:
                self.diameters_mm.append(item.pupil_diameter_mm)
            began_ns = time.thread_time_ns()
            found = self.calibration.step(item)
            self.worst_step_ns = max(self.worst_step_ns, time.thread_time_ns() - began_ns)
            if found is not None:
                self.maps.append(found)
                self.without_map = len(self.states)
                self.chain.use(found)
            self.states += [record for record in self.chain.step(item) if isinstance(record, EyeState)]
            stage = (self.calibration.status() or {"stage": "none"})["stage"]
            if [stage] != self.stages[-1:]:
                self.stages.append(stage)
            if condition():
                return
            assert time.monotonic() < give_up, self.stages
        pytest.fail("the eyes have died")


@pytest.fixture
def eyes() -> PromptEyes:
    return PromptEyes()


@pytest.fixture
def loop(eyes: PromptEyes) -> Iterator[BridgeLoop]:
    calibration = PupilCalibration(Room(SocketDisplay(ANY, ANY), eyes), "made-up eyes", scene_cd_m2=SCENE_CD_M2)
    yield BridgeLoop(calibration, eyes)
    calibration.close()


def addresses(calibration: PupilCalibration) -> tuple[str, str]:
    display = calibration._display
    assert isinstance(display, SocketDisplay)
    return display.commands_address, display.answers_address


def request(folder: Path, **changes: object) -> CalibratePupils:
    return msgspec.convert({"out": str(folder / "my_pupil.toml"), **QUICK, **changes}, CalibratePupils)


# A busy machine is late now and then: at rest nine in ten samples are there.
@pytest.mark.parametrize("tracked", [0.5, pytest.param(0.9, marks=pytest.mark.slow)])
def test_a_valid_run_leaves_a_map_a_plot_and_diameters_that_mean_something(
    tmp_path: Path, loop: BridgeLoop, eyes: PromptEyes, tracked: float
) -> None:
    calibration = loop.calibration
    assert (calibration.status(), calibration.result()) == (None, None)
    assert calibration.begin(request(tmp_path)).done
    assert not calibration.begin(request(tmp_path)).done  # one at a time
    with ScreenProgram(*addresses(calibration)) as program:
        loop.until(lambda: program.told("Press Start"))
        status = calibration.status()
        assert status is not None
        assert (status["stage"], status["step"], status["steps"], status["display"]) == ("ready", 0, 2, True)
        program.say({"request": "start"})
        loop.until(lambda: (calibration.status() or {}).get("screen") == "white")
        loop.until(lambda: (calibration.status() or {}).get("stage") == "showing")
        calibration.scene_light(3.0, time.monotonic_ns())
        assert eyes.lights[-1] == 200.0  # not now
        status = calibration.status()
        assert status is not None
        assert (status["step"], status["seconds"]) == (2, 4.0)
        assert 2.0 <= status["seconds_done"] <= 4.0
        loop.until(calibration.result)
        loop.until(lambda: program.told("Done, thank you"))
    assert eyes.lights[:3] == [SCENE_CD_M2, 0.05, 200.0]
    assert eyes.lights[-1] == 3.0  # what the scene has become meanwhile
    result = calibration.result()
    assert result is not None
    assert (result["ok"], result["problems"]) == (True, []), result
    assert result["eyes"]["left"]["span"] == pytest.approx(54, abs=8)
    assert result["eyes"]["left"]["unit"] == "px"
    assert tracked < result["eyes"]["left"]["tracked_share"] <= 1
    assert {path.name for path in tmp_path.iterdir()} == {"my_pupil.toml", "my_pupil.png"}
    (found,) = loop.maps
    assert found.left is not None
    assert pupil_map.read(tmp_path / "my_pupil.toml").left is not None
    assert loop.stages[-2:] == [WORKING_OUT, "none"]
    assert msgspec.json.decode(msgspec.json.encode(result)) == result  # for a page
    # Pixels were no diameters; from the new map on they are.
    assert {state.left.pupil_diameter_mm for state in loop.states[: loop.without_map]} == {None}
    steady_mm = 2 + 6 * (px_at(3.0) - found.left.white) / (found.left.black - found.left.white)
    loop.until(lambda: loop.states[-1].left.pupil_diameter_mm == pytest.approx(steady_mm, abs=0.1))
    assert loop.states[-1].left.phase is Phase.TRACKING
    # Nothing of all this was the loop's work, the drawing least of all, which takes a second.
    assert loop.worst_step_ns < 500_000_000


def test_simulated_eyes_see_the_screens_and_then_the_scene(tmp_path: Path) -> None:
    settings = SimulatedSettings(seconds=30.0, seed=1, luminance=((0.0, SCENE_CD_M2),), blinks_per_minute=0.0)
    eyes = LiveEyes(settings, time.monotonic_ns())
    calibration = PupilCalibration(Room(SocketDisplay(ANY, ANY), eyes), eyes.info.name, scene_cd_m2=SCENE_CD_M2)
    loop = BridgeLoop(calibration, eyes)
    try:
        assert calibration.begin(request(tmp_path, white_s=2.0, black_s=2.0, eyes="left")).done
        with ScreenProgram(*addresses(calibration)) as program:
            program.say({"request": "start"})
            loop.until(lambda: loop.stages[-1] == WORKING_OUT)
        before_white_mm = loop.diameters_mm[-1]
        assert before_white_mm < max(loop.diameters_mm) - 1.0
        loop.until(lambda: loop.diameters_mm[-1] > before_white_mm + 0.3)  # it opens again
    finally:
        calibration.close()


def test_a_failed_run_says_what_is_wrong_and_changes_nothing(tmp_path: Path, loop: BridgeLoop) -> None:
    calibration = loop.calibration
    calibration._room = type(calibration._room)(calibration._room.display, None)  # eyes that see no screens
    assert calibration.begin(request(tmp_path)).done
    with ScreenProgram(*addresses(calibration)) as program:
        program.say({"request": "start"})
        loop.until(calibration.result)
        loop.until(lambda: program.told("No result: no span"))
    result = calibration.result()
    assert result is not None
    assert result["ok"] is False
    assert result["problems"][0]["name"].startswith("no span")
    assert "fill the view" in result["problems"][0]["remedy"]
    assert result["eyes"]["left"]["white"] > 0
    assert result["plot"] == str(tmp_path / "my_pupil.failed.png")
    assert {path.name for path in tmp_path.iterdir()} == {"my_pupil.failed.png"}
    assert loop.maps == []


def test_a_run_can_be_stopped_from_both_sides_and_begun_anew(
    tmp_path: Path, loop: BridgeLoop, eyes: PromptEyes
) -> None:
    calibration = loop.calibration
    assert "nothing to stop" in calibration.stop().reply
    with ScreenProgram(*addresses(calibration)) as program:
        for stop in (lambda: calibration.stop(), lambda: program.say({"request": "abort"})):
            assert calibration.begin(request(tmp_path)).done
            assert calibration.result() is None
            program.say({"request": "start"})
            loop.until(lambda: (calibration.status() or {}).get("stage") == "showing")
            stop()
            loop.until(calibration.result)
            loop.until(lambda: program.screen == "grey")
            assert eyes.lights[-1] == SCENE_CD_M2
        result = calibration.result()
        assert result is not None
        assert (result["ok"], [one["name"] for one in result["problems"]]) == (False, ["aborted"])
        assert list(tmp_path.iterdir()) == []
        # No screen has the number of one that was shown before.
        assert len({number for number, _ in program.screens}) == len(program.screens)


def test_a_display_that_is_lost_in_the_middle_pauses_and_another_one_goes_on(tmp_path: Path, loop: BridgeLoop) -> None:
    calibration = loop.calibration
    assert calibration.begin(request(tmp_path)).done
    with ScreenProgram(*addresses(calibration)) as program:
        program.say({"request": "start"})
        loop.until(lambda: (calibration.status() or {}).get("stage") == "showing")
    loop.until(lambda: (calibration.status() or {}).get("stage") == "paused")
    status = calibration.status()
    assert status is not None
    assert status["display"] is False
    with ScreenProgram(*addresses(calibration), clock_ahead_ns=5 * NS_PER_S) as program:
        loop.until(lambda: program.screen == "grey")  # it is told how things stand
        program.say({"request": "start"})
        loop.until(lambda: loop.stages[-1] == WORKING_OUT)  # both screens were shown to their end
    assert [screen for _, screen in program.screens] == ["grey", "black", "white", "grey"]


def test_what_cannot_be_done_is_said_before_anything_is_shown(tmp_path: Path, loop: BridgeLoop) -> None:
    begin = loop.calibration.begin
    assert "TOML file" in begin(request(tmp_path, out="pupil.txt")).reply
    assert "no folder" in begin(request(tmp_path, out=str(tmp_path / "nowhere" / "p.toml"))).reply
    assert "choose from 5" in begin(request(tmp_path, protocol="robust")).reply
    assert loop.calibration.status() is None


def test_a_start_without_a_display_is_forgotten(tmp_path: Path, loop: BridgeLoop) -> None:
    calibration = loop.calibration
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    operator = context.socket(zmq.PUSH)
    operator.connect(addresses(calibration)[1])
    try:
        assert calibration.begin(request(tmp_path)).done
        operator.send(msgspec.msgpack.encode({"request": "start"}))
        until_s = time.monotonic() + 3.5
        loop.until(lambda: time.monotonic() > until_s)
        with ScreenProgram(*addresses(calibration)) as program:
            loop.until(lambda: program.told("does not answer"))
            assert (calibration.status() or {})["stage"] == "ready"
            # With one, the operator may start too.
            operator.send(msgspec.msgpack.encode({"request": "start"}))
            loop.until(lambda: program.screen == "black")
    finally:
        context.destroy(linger=0)


def test_idle_and_running_it_costs_next_to_nothing(tmp_path: Path, loop: BridgeLoop) -> None:
    sample = PupilSample(0, Eye.LEFT, 3.0, 1.0, 1.0, 40.0, 1.0)

    def step_us() -> float:
        began_ns = time.thread_time_ns()
        for _ in range(20_000):
            loop.calibration.step(sample)
        return (time.thread_time_ns() - began_ns) / 20_000 / 1e3

    idle_us = step_us()
    assert loop.calibration.begin(request(tmp_path)).done
    running_us = step_us()
    print(f"\na step costs {idle_us:.2f} µs idle, {running_us:.2f} µs while a run waits")
    assert idle_us < 5
    assert running_us < 50


def test_beyond_this_machine_it_takes_keys(tmp_path: Path, eyes: PromptEyes) -> None:
    with pytest.raises(OpenAddressError):
        SocketDisplay("tcp://0.0.0.0:*", ANY)
    out = tmp_path / "keys"
    key_files.make_bridge(out)
    server = key_files.load_server(out / "bridge")
    known = key_files.load_client(key_files.make_client(out, "console"))
    publisher = Publisher(ANY, ANY, keys=server)
    display = SocketDisplay("tcp://0.0.0.0:*", "tcp://0.0.0.0:*", keys=server, context=publisher.context)
    calibration = PupilCalibration(Room(display), "eyes")
    here = [address.replace("0.0.0.0", "127.0.0.1") for address in (display.commands_address, display.answers_address)]
    loop = BridgeLoop(calibration, eyes)
    try:
        assert calibration.begin(request(tmp_path)).done
        with ScreenProgram(*here) as stranger, ScreenProgram(*here, keys=known) as program:
            stranger.say({"request": "abort"})
            loop.until(lambda: program.told("Press Start"))
            program.say({"request": "start"})
            loop.until(lambda: program.screen == "black")
            assert stranger.said == []
            calibration.stop()
    finally:
        calibration.close()
        publisher.close()


def test_a_display_of_its_own_context_keeps_its_own_door(tmp_path: Path) -> None:
    key_files.make_bridge(tmp_path)
    server = key_files.load_server(tmp_path / "bridge")
    known = key_files.load_client(key_files.make_client(tmp_path, "display"))
    display = SocketDisplay(ANY, ANY, keys=server)
    addresses = display.commands_address, display.answers_address
    with ScreenProgram(*addresses) as stranger, ScreenProgram(*addresses, keys=known) as program:
        give_up = time.monotonic() + PATIENCE_S
        while not display.ready:
            assert time.monotonic() < give_up
            time.sleep(0.01)
        assert program.told(READY_WORDS)
        assert stranger.said == []
    display.close()

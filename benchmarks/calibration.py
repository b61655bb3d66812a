"""How far off a pupil calibration is, by protocol: simulated eyes whose true diameters are known."""

from __future__ import annotations

import numpy as np

from entoptic.services.calibration.display import NoDisplay
from entoptic.services.calibration.result import judge
from entoptic.services.calibration.run import GREY_SHARE, CalibrationRun, Room
from entoptic.tracker_bridge.calibration import Protocol, Screen, Statistic, Step, luidolt, robust
from entoptic.tracker_bridge.calibration_quality import Analysis
from entoptic.tracker_bridge.samples import Eye
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.live import LiveEyes
from entoptic.tracker_bridge.sources.simulated.pupil import watson_yellott_mm

SEEDS = range(1, 13)
WHITE_CD_M2, BLACK_CD_M2 = 200.0, 0.05


def short() -> Protocol:
    """Robust, but with 5 s of white and 10 s of black, the last 3 s of each."""
    white, black = Step(Screen.WHITE, 5.0, 3.0), Step(Screen.BLACK, 10.0, 3.0)
    return Protocol("white 5 s, black 10 s", (white, black, white), Statistic.MEDIAN, must_settle=True)


def calibrate(protocol: Protocol, seed: int, hippus: float) -> Analysis:
    """One run of a protocol before eyes that blink and a tracker that is noisy, as by default."""
    settings = SimulatedSettings(
        seconds=protocol.seconds + 5.0, seed=seed, hippus=hippus, luminance=((0.0, GREY_SHARE * WHITE_CD_M2),)
    )
    eyes = LiveEyes(settings)
    run = CalibrationRun(protocol, Room(NoDisplay(), eyes, WHITE_CD_M2, BLACK_CD_M2))
    for item in eyes.samples():
        run.step(item, item.t_ns)
    return judge(run.recorded()).analysis


def main() -> None:
    """Prints a Markdown table."""
    settings = SimulatedSettings()
    true_mm = {
        screen: watson_yellott_mm(luminance, settings.field_deg2, settings.age_years)
        for screen, luminance in ((Screen.WHITE, WHITE_CD_M2), (Screen.BLACK, BLACK_CD_M2))
    }
    print(
        f"\n### Pupil calibration, off the truth (white {true_mm[Screen.WHITE]:.2f} mm, black "
        f"{true_mm[Screen.BLACK]:.2f} mm): median of {len(SEEDS)} simulated people, and the middle 90 %\n\n"
        "| protocol | seconds | hippus | white, mm | black, mm | accepted |\n|---|---:|---|---:|---:|---:|"
    )
    for protocol in (robust(), short(), luidolt()):
        for hippus in (0.0, settings.hippus):
            runs = [calibrate(protocol, seed, hippus) for seed in SEEDS]
            cells = []
            for screen in (Screen.WHITE, Screen.BLACK):
                off_mm = [run.eyes[eye].of(screen) - true_mm[screen] for run in runs for eye in Eye]
                low, middle, high = np.percentile(off_mm, [5, 50, 95])
                cells.append(f"{middle:+.3f} ({low:+.2f} … {high:+.2f})")
            accepted = sum(not run.problems for run in runs)
            print(
                f"| {protocol.name} | {protocol.seconds:.0f} | {'yes' if hippus else 'no'} | {' | '.join(cells)} | "
                f"{accepted} of {len(runs)} |"
            )


if __name__ == "__main__":
    main()

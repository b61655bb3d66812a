"""All timings. What takes minutes and measures no time is run by its own name: see docs/bridge.md."""

from benchmarks import (
    acuity,
    adaptation,
    budget,
    chain,
    effects,
    glare,
    kernels,
    night_colour,
    skipping,
    tone,
    transport,
    whole_frame,
)

for benchmark in (
    whole_frame,
    skipping,
    budget,
    effects,
    adaptation,
    glare,
    acuity,
    tone,
    night_colour,
    kernels,
    chain,
    transport,
):
    benchmark.main()

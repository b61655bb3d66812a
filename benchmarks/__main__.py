"""All timings. What takes minutes and measures no time is run by its own name: see docs/bridge.md."""

from benchmarks import chain, kernels, living_eye, planning, transport, whole_frame

for benchmark in (whole_frame, living_eye, planning, kernels, chain, transport):
    benchmark.main()

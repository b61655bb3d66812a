"""All timings. What takes minutes and measures no time is run by its own name: see docs/bridge.md."""

from benchmarks import chain, kernels, planning, transport, whole_frame

for benchmark in (whole_frame, planning, kernels, chain, transport):
    benchmark.main()

"""All timings. What takes minutes and measures no time is run by its own name: see docs/bridge.md."""

from benchmarks import chain, effects, glare, kernels, transport

for benchmark in (effects, glare, kernels, chain, transport):
    benchmark.main()

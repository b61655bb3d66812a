"""All timings."""

from benchmarks import chain, effects, kernels

for benchmark in (effects, kernels, chain):
    benchmark.main()

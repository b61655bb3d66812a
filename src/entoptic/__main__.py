"""`python -m entoptic`: the command line."""

from entoptic.services.cli import main

main()

"""What a person at a terminal reads."""

from rich.console import Console

console = Console(stderr=True, highlight=False)

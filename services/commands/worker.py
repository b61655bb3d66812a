"""`entoptic worker`: renders what a bridge publishes, by the clock."""

from __future__ import annotations

from entoptic.services.command_line import options
from entoptic.services.config import SettingsConfig, ViewConfig
from entoptic.services.process import prepare_jax, process
from entoptic.services.process_config import WorkerLinks


@options
def worker(links: WorkerLinks, view: ViewConfig, settings: SettingsConfig) -> None:
    """Render what a bridge publishes, by the clock."""
    with process() as (stop, log):
        prepare_jax()
        from entoptic.services import settings as all_settings
        from entoptic.services.session_config import WorkerConfig
        from entoptic.services.worker import live

        live.run(WorkerConfig(links=links, view=view, settings=all_settings.of(settings)), stop, log)

"""Context given to every page."""

from dataclasses import dataclass

from accelbench.panel.access.sessions import Sessions
from accelbench.panel.actions import Actions
from accelbench.panel.settings import PanelSettings
from accelbench.panel.watch import StoreWatch


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelContext:
    """Settings, log-ins, actions and the reader of the store."""

    settings: PanelSettings
    sessions: Sessions
    actions: Actions
    watch: StoreWatch

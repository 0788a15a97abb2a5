"""Work that may wait, in a thread of its own, so that no page stands still meanwhile."""

import asyncio
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from nicegui import Client, ui

from accelbench.panel.actions import Outcome

P = ParamSpec("P")
R = TypeVar("R")


async def in_thread(function: Callable[P, R], *args: P.args, **given: P.kwargs) -> R:
    """Call a function that may wait, in a thread."""
    return await asyncio.to_thread(function, *args, **given)


def tell(outcome: Outcome, client: Client) -> None:
    """Show on a page how an action ended; what was not done stays until it is closed.

    The page is named, because the button that began the action may be gone meanwhile.
    """
    with client:
        if outcome.done:
            ui.notify(outcome.said, type="positive", timeout=6000)
        else:
            ui.notify(
                outcome.said, type="negative", timeout=0, close_button="Close", multi_line=True
            )

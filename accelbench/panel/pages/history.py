"""The page History: every action on the page, with who and when."""

from html import escape

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.context import PanelContext
from accelbench.panel.frame import frame, local_time, table
from accelbench.panel.work import in_thread

SHOWN = 300


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/history")
    async def history_page(request: Request) -> None:
        with frame(context, request, "History", "/history"):
            ui.html("<h1>History</h1>", sanitize=False)
            log = context.actions.log
            with ui.element("div").classes("card"):
                ui.label(
                    f"Actions on this page, from {log.path.name}; commands of a terminal stand "
                    "on the page Queue."
                ).classes("note")
                lines = await in_thread(log.newest, SHOWN)
                known = ("utc", "who", "action", "outcome")
                rows = [
                    [
                        local_time(str(one["utc"])),
                        escape(str(one["who"])),
                        escape(str(one["action"])),
                        escape(str(one["outcome"])),
                        escape(
                            ", ".join(
                                f"{k} {v}"
                                for k, v in one.items()
                                if k not in known and v is not None
                            )
                        ),
                    ]
                    for one in lines
                ]
                columns = ["when", "who", "what", "what came of it", "of"]
                text = table(columns, rows) if rows else "<div class=note>none yet</div>"
                ui.html(text, sanitize=False).classes("w-full")

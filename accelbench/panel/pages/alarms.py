"""The page Alarms: what each means and what to do, acknowledged by a person; the notices."""

from functools import partial
from html import escape

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.access.sessions import Visitor
from accelbench.panel.access.users import may
from accelbench.panel.context import PanelContext
from accelbench.panel.frame import frame, local_time, table
from accelbench.panel.work import in_thread, tell
from thermo.launch.notify import default_notify_file
from thermo.store.operation.alarms import Alarm, list_alarms
from thermo.store.operation.notices import Notice, list_notices
from thermo.store.store import open_store

SHOWN = 200
COLOUR = {"danger": ("bad", "✖"), "warning": ("warn", "▲"), "news": ("good", "✔")}


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/alarms")
    def alarms_page(request: Request) -> None:
        with frame(context, request, "Alarms", "/alarms") as visitor:
            _AlarmsPage(context, visitor)


class _AlarmsPage:
    """The elements of one open page."""

    def __init__(self, context: PanelContext, visitor: Visitor) -> None:
        self._context, self._visitor = context, visitor
        self._client = ui.context.client
        self._seen: object = None
        ui.html("<h1>Alarms</h1>", sanitize=False)
        self._open = ui.column().classes("w-full gap-2")
        with ui.element("div").classes("card"):
            self._make_notices()
        with ui.element("div").classes("card"):
            ui.html("<h2>Acknowledged</h2>", sanitize=False)
            self._past = ui.html("", sanitize=False).classes("w-full")
        ui.timer(0.5, self._tick)

    def _make_notices(self) -> None:
        ui.html("<h2>Notices to people elsewhere</h2>", sanitize=False)
        path = self._context.settings.notify or default_notify_file()
        self._is_told = path.exists()
        ui.label(
            f"Who is told stands in {path.name}; a notice that is not taken is tried again."
            if self._is_told
            else f"Nobody is told: there is no {path.name}; --notify names another file."
        )
        self._waiting = ui.html("", sanitize=False).classes("w-full")
        if may(self._visitor.role, "operate"):
            ui.button("Send a trial to every address", on_click=self._try, color=None).props("flat")

    async def _tick(self) -> None:
        snapshot = self._context.watch.snapshot
        now = (snapshot.alarms, snapshot.notices)
        if now == self._seen:
            return
        self._seen = now
        self._open.clear()
        with self._open:
            if not snapshot.alarms:
                ui.html("<div class='strip good'>✔ No alarm is open.</div>", sanitize=False)
            for alarm in reversed(snapshot.alarms):
                self._card(alarm)
        self._waiting.set_content(self._not_sent(snapshot.notices))
        past, sent = await in_thread(_history, self._context.settings.store)
        self._past.set_content(_past(past))
        self._waiting.set_content(self._not_sent(snapshot.notices) + _sent(sent))

    def _not_sent(self, notices: tuple[Notice, ...]) -> str:
        return _waiting(notices) if self._is_told else ""

    def _card(self, alarm: Alarm) -> None:
        about = alarm.about
        colour, sign = COLOUR[about.weight]
        times = (
            "" if alarm.times == 1 else f" · {alarm.times} times, last {local_time(alarm.last_utc)}"
        )
        of = (
            ""
            if alarm.test_id is None
            else (f" · <a href='/test/{escape(alarm.test_id)}'>{escape(alarm.test_id)}</a>")
        )
        with ui.element("div").classes(f"strip {colour}"):
            ui.html(
                f"<b>{sign} {alarm.number} · {escape(about.title)}</b> · "
                f"{local_time(alarm.raised_utc)}{times}{of}<div>{escape(alarm.text)}</div>"
                f"<div>It means: {escape(about.meaning)}</div>"
                f"<div>To do: {escape(about.remedy)}</div>",
                sanitize=False,
            )
            if may(self._visitor.role, "operate"):
                button = ui.button("Acknowledge", on_click=partial(self._acknowledge, alarm.number))
                button.props("unelevated dense color=dark")

    async def _acknowledge(self, number: int) -> None:
        tell(
            await in_thread(self._context.actions.acknowledge, self._visitor, number), self._client
        )

    async def _try(self) -> None:
        ui.notify("Sending …")
        tell(await in_thread(self._context.actions.try_notices, self._visitor), self._client)


def _history(url: str) -> tuple[tuple[Alarm, ...], tuple[Notice, ...]]:
    with open_store(url) as store:
        past = tuple(a for a in list_alarms(store) if not a.is_open)
        return past[-SHOWN:], list_notices(store)[-SHOWN:]


def _past(alarms: tuple[Alarm, ...]) -> str:
    rows = [
        [
            str(a.number),
            escape(a.about.title),
            escape(a.test_id or "–"),
            local_time(a.raised_utc),
            escape(a.text),
            escape(a.acknowledged_by or ""),
            local_time(a.acknowledged_utc),
        ]
        for a in reversed(alarms)
    ]
    if not rows:
        return "<div class=note>none yet</div>"
    return table(["number", "alarm", "test", "raised", "what", "acknowledged by", "when"], rows)


def _waiting(notices: tuple[Notice, ...]) -> str:
    if not notices:
        return "<div class=note>No notice waits to be sent.</div>"
    rows = [
        [escape(n.text), str(n.tries), local_time(n.next_utc), escape(n.last_error)]
        for n in notices
    ]
    head = f"<div class='strip warn'>▲ {len(notices)} not sent yet</div>"
    return head + table(["notice", "tries", "next try", "why not"], rows)


def _sent(notices: tuple[Notice, ...]) -> str:
    rows = [
        [local_time(n.sent_utc), escape(n.kind), escape(n.text)]
        for n in reversed(notices)
        if n.state == "sent"
    ]
    return table(["sent", "kind", "notice"], rows[:20]) if rows else ""

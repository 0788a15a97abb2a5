"""The pictures of a test, as options of ECharts: lines told apart by dash and marker, too."""

from collections.abc import Sequence
from typing import Any, cast

from accelbench.panel.followed import FollowedTest

# Okabe and Ito's colours without yellow, readable on white and on black, and told apart by
# colour-blind people
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8a8a8a")
DASHES = ("solid", "dashed", "dotted")
GREY = "#8a8f94"
Options = dict[str, Any]
Points = Sequence[Sequence[float | None]]


def _line(name: str, data: Points, index: int, **more: Any) -> Options:
    """Return a line; after the last colour the dashes change."""
    style = {
        "color": COLOURS[index % len(COLOURS)],
        "type": DASHES[(index // len(COLOURS)) % len(DASHES)],
        "width": 1.5,
    }
    return {
        "type": "line",
        "name": name,
        "data": data,
        "showSymbol": False,
        "connectNulls": False,
        "lineStyle": style | more.pop("lineStyle", {}),
        "itemStyle": {"color": style["color"]},
        "emphasis": {"focus": "series"},
        "animation": False,
        **more,
    }


def _chart(
    title: str, unit: str, series: list[Options], aria: str, hours: float | None = None
) -> Options:
    return {
        "animation": False,
        "aria": {"enabled": True, "label": {"description": aria}},
        "title": {"text": title, "textStyle": {"fontSize": 13, "color": GREY}, "left": 0, "top": 0},
        "legend": {"type": "scroll", "top": 20, "left": 0, "textStyle": {"color": GREY}},
        "grid": {"left": 62, "right": 18, "top": 50, "bottom": 42},
        "tooltip": {"trigger": "axis", "valueFormatter": None, "confine": True},
        "toolbox": {
            "feature": {"dataZoom": {"yAxisIndex": "none"}, "restore": {}, "saveAsImage": {}},
            "right": 10,
            "top": 0,
            "itemSize": 12,
        },
        "dataZoom": [{"type": "inside", "filterMode": "none"}],
        "xAxis": {
            "type": "value",
            "name": "programme time, h",
            "nameLocation": "middle",
            "nameGap": 24,
            "min": 0,
            "max": hours,
            "axisLine": {"onZero": False},
            "axisLabel": {"color": GREY},
            "nameTextStyle": {"color": GREY},
            "splitLine": {"lineStyle": {"opacity": 0.25}},
        },
        "yAxis": {
            "type": "value",
            "name": unit,
            "nameLocation": "middle",
            "nameGap": 46,
            "scale": True,
            "axisLabel": {"color": GREY},
            "nameTextStyle": {"color": GREY},
            "splitLine": {"lineStyle": {"opacity": 0.25}},
        },
        "series": series,
    }


def temperature_chart(test: FollowedTest) -> Options:
    """Return programme with its band, chamber and accelerometers over time."""
    programme = test.programme()
    width_c = test.plan.sequence.limits.max_deviation_c
    dashed = {"color": GREY, "type": "dashed", "width": 1.2}
    edge = {"color": GREY, "type": "dotted", "width": 0.8}
    band = f"limit of deviation, ±{width_c:g} °C"
    series = [
        _line("programme", programme, 0, lineStyle=dashed, itemStyle={"color": GREY}),
        _line(band, _shifted(programme, -width_c), 0, lineStyle=edge, itemStyle={"color": GREY}),
        _line(band, _shifted(programme, width_c), 0, lineStyle=edge, itemStyle={"color": GREY}),
        _line("chamber", test.line("chamber"), 0, lineStyle={"width": 2.2}),
        *(_line(s, test.line(s), k + 1) for k, s in enumerate(test.serials)),
    ]
    what = "Temperatures of chamber and accelerometers against the programme"
    return _chart("Temperature", "°C", series, what, _hours(test))


def rate_chart(test: FollowedTest) -> Options:
    """Return the ramp rate of chamber and first accelerometer over time."""
    window = test.plan.sequence.uniformity.window_min
    first = test.serials[0]
    series = [
        _line("chamber", test.rate("chamber"), 0),
        _line(first, test.rate(first), 1, lineStyle={"type": "dashed"}),
    ]
    title = f"Ramp rate over {window:g} min"
    return _chart(title, "°C/min", series, "Rate of the temperatures", _hours(test))


def output_chart(test: FollowedTest) -> Options:
    """Return every accelerometer's output over time."""
    units = sorted(set(test.units.values()))
    series = [
        _line(
            s,
            test.line(f"output {s}"),
            k + 1,
            showSymbol=True,
            symbolSize=2,
            lineStyle={"width": 0.4},
        )
        for k, s in enumerate(test.serials)
    ]
    return _chart("Output", ", ".join(units), series, "Outputs of the accelerometers", _hours(test))


def plan_chart(hours: list[float], temps_c: list[float], angles: list[list[float]]) -> Options:
    """Return the temperature programme over time, and the head's positions below."""
    programme = [[h, t] for h, t in zip(hours, temps_c, strict=True)]
    options = _chart("Programme", "°C", [], "Planned temperature and head positions over time")
    positions = _line("head", angles, 1, xAxisIndex=1, yAxisIndex=1, showSymbol=True, symbolSize=3)
    positions["lineStyle"]["width"] = 0.3
    x, y = options["xAxis"], options["yAxis"]
    options["grid"] = [
        {"left": 62, "right": 18, "top": 50, "height": "42%"},
        {"left": 62, "right": 18, "bottom": 42, "height": "22%"},
    ]
    options["xAxis"] = [x | {"gridIndex": 0, "name": ""}, x | {"gridIndex": 1}]
    options["yAxis"] = [y | {"gridIndex": 0}, y | {"gridIndex": 1, "name": "head, °"}]
    options["dataZoom"] = [{"type": "inside", "xAxisIndex": [0, 1], "filterMode": "none"}]
    options["series"] = [_line("temperature", programme, 0, lineStyle={"width": 2.0}), positions]
    return options


def life_chart(title: str, unit: str, points: list[tuple[str, float, float]]) -> Options:
    """Return a coefficient from test to test with its sigmas; a point is name, value, sigma."""
    bars: list[list[float | None]] = []
    for k, (_, value, sigma) in enumerate(points):
        low, high, gap = [k, value - sigma], [k, value + sigma], [None, None]
        bars.extend(cast(list[list[float | None]], [low, high, gap]))
    series = [
        _line("± 1 sigma", bars, 0, lineStyle={"width": 2.0}),
        _line(
            "value",
            [[k, value] for k, (_, value, _) in enumerate(points)],
            0,
            showSymbol=True,
            symbolSize=8,
            lineStyle={"width": 0.5, "type": "dotted"},
        ),
    ]
    options = _chart(title, unit, series, title)
    names = [name for name, _, _ in points]
    options["xAxis"] |= {"type": "category", "data": names, "name": "begin of the test, UTC"}
    options["xAxis"].pop("min")
    options["grid"] |= {"left": 92}
    options["yAxis"] |= {"nameGap": 76}
    return options


def _hours(test: FollowedTest) -> float:
    """Return the end of the programme in h, the same in all pictures of a test."""
    return round(test.plan.total_s / 3600.0, 2)


def _shifted(points: list[list[float | None]], by: float) -> list[list[float | None]]:
    return [[x, None if y is None else y + by] for x, y in points]

"""Both Jaccard indices, ray by ray."""

from collections.abc import Mapping, Sequence

from nicegui import ui

from tactile_core.exploration.world.rays import RAYS
from tactile_core.figures.style import FAINT, INK, MUTED

# Okabe and Ito's blue and vermilion; shape and dashes tell them apart as well.
YOU = {"colour": "#0072b2", "symbol": "circle", "dashes": "solid"}
OPPONENT = {"colour": "#d55e00", "symbol": "triangle", "dashes": "dashed"}
CLOSE = 8  # in Jaccard indices: numbers at the ends of curves would overlap


def empty_chart() -> ui.echart:
    return ui.echart(
        {
            "animation": False,
            "grid": {"left": 38, "right": 46, "top": 30, "bottom": 34},
            "legend": {"top": 0, "left": 30, "itemWidth": 28, "textStyle": {"color": INK}},
            "tooltip": {"trigger": "axis"},
            "xAxis": {
                "type": "value", "min": 0, "max": RAYS, "interval": 1, "name": "rays",
                "nameLocation": "middle", "nameGap": 20, "splitLine": {"show": False},
                "axisLabel": {"color": MUTED}, "nameTextStyle": {"color": MUTED},
            },
            "yAxis": {
                "type": "value", "min": 0, "max": 100, "interval": 20,
                "splitLine": {"lineStyle": {"color": FAINT}}, "axisLabel": {"color": MUTED},
            },
            "series": [],
        }
    ).classes("chart")  # fmt: skip


def draw_curves(chart: ui.echart, curves: Mapping[str, Sequence[float]]) -> None:
    """Show the Jaccard index (0–100) before the first ray and after each; yours first."""
    chart.options["series"] = [
        {
            "type": "line", "name": name,
            "data": [[ray, round(index, 1)] for ray, index in enumerate(curve)],
            "symbol": look["symbol"], "symbolSize": 8, "color": look["colour"],
            "lineStyle": {"type": look["dashes"], "width": 2.5},
            "endLabel": {
                "show": True, "formatter": "{@[1]}", "color": look["colour"], "offset": [0, aside],
            },
        }
        for (name, curve), look, aside in zip(
            curves.items(), (YOU, OPPONENT), apart([*curves.values()]), strict=False
        )
    ]  # fmt: skip
    chart.update()


def apart(curves: Sequence[Sequence[float]]) -> tuple[int, int]:
    """By how many pixels the numbers at the ends of two curves move down, lest they overlap."""
    if len(curves) < 2 or abs(curves[0][-1] - curves[1][-1]) > CLOSE:
        return 0, 0
    return (7, -7) if curves[0][-1] < curves[1][-1] else (-7, 7)

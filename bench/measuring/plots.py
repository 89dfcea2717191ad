"""The plot of error against time: a panel for each view."""

import math

from .page import EXACT, NAMES, PEER_NAMES

COLORS = {"moments": "#1f6fb4", "octant": "#e07b00"}
PEER_MARKS = {"projected-tets": ("*", "#222222", 15), "ray-cast": ("D", "#8a2be2", 8)}


def _milliseconds(row):
    return 1e3 * row.frame_s


def _splats(panel, rows, color, kernel):
    usual = [row for row in rows if row.sort == "exact" and row.raster == "splats" and row.sampling == "auto"]
    sampled = [row for row in rows if row.sampling == "4"]
    by_tolerance = sorted((row for row in usual if row.tolerance is not None), key=lambda row: row.tolerance)
    panel.plot(
        [_milliseconds(row) for row in by_tolerance],
        [row.rmse for row in by_tolerance],
        "o-",
        color=color,
        markersize=5,
        linewidth=1.5,
        label=f"{kernel}, by tolerance",
    )
    mixed = sorted((row for row in rows if row.raster == "slabs"), key=lambda row: row.tolerance)
    if mixed:
        panel.plot(
            [_milliseconds(row) for row in mixed],
            [row.rmse for row in mixed],
            "s--",
            color=color,
            markersize=4,
            linewidth=1,
            label="slabs, by tolerance",
        )
    by_resolution = [row for row in usual if row.resolution is not None]
    panel.plot(
        [_milliseconds(row) for row in by_resolution],
        [row.rmse for row in by_resolution],
        "o",
        color=color,
        markersize=7,
        markerfacecolor="none",
        label=f"{kernel}, fixed resolutions",
    )
    if sampled:
        panel.plot(
            [_milliseconds(row) for row in sampled],
            [row.rmse for row in sampled],
            "x",
            color=color,
            markersize=5,
            label=f"{kernel}, samples 4 pixels apart",
        )
    for row in by_tolerance:
        if row.tolerance in (0, 1, 5, 20):
            panel.annotate(
                "all" if row.tolerance == 0 else f"{row.tolerance:g} %",
                (_milliseconds(row), row.rmse),
                xytext=(3, 5),
                textcoords="offset points",
                fontsize=8,
                color=color,
            )


def _peer(panel, row, kind):
    mark, color, size = PEER_MARKS[kind]
    spread = [[1e3 * (row.frame_s - row.frame_min_s)], [1e3 * (row.frame_max_s - row.frame_s)]]
    style = {"fmt": mark, "color": color, "markersize": size, "capsize": 3, "label": PEER_NAMES[kind]}
    panel.errorbar([_milliseconds(row)], [row.rmse], xerr=spread, **style)


def draw(results, path):
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    columns = min(4, len(results.views) + 1)
    figure = Figure(figsize=(4.2 * columns, 3.9 * math.ceil((len(results.views) + 1) / columns)), layout="constrained")
    panels = figure.subplots(math.ceil((len(results.views) + 1) / columns), columns, squeeze=False).flatten()
    for panel, view in zip(panels, results.views):
        for kernel in results.kernels:
            rows = results.of(view=view, kernel=kernel, device=results.device)
            _splats(panel, rows, COLORS.get(kernel, "#2a9d4a"), kernel)
        for kind in PEER_NAMES:
            if peer := results.one(view=view, kernel=kind):
                _peer(panel, peer, kind)
        if exact := results.one(view=view, kernel=EXACT):  # its error is 0, which has no position here
            panel.axvline(_milliseconds(exact), linestyle=":", color="#222222", label=NAMES[EXACT].replace("`", ""))
        panel.margins(0.1)
        panel.set(xscale="log", yscale="log", title=view, xlabel="frame, ms", ylabel="RMSE, linear RGB")
        panel.grid(True, color="#e4e4e4", linewidth=0.6)
        panel.set_axisbelow(True)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(
                FuncFormatter(lambda value, _: f"{value:g}" if value < 1e4 else f"{value / 1e3:g}k")
            )
            axis.set_minor_formatter(NullFormatter())
        panel.tick_params(labelsize=8)
    for panel in panels[len(results.views) :]:
        panel.axis("off")
    handles, labels = panels[0].get_legend_handles_labels()
    panels[len(results.views)].legend(handles, labels, loc="center", frameon=False, fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, metadata={"Software": None}, pil_kwargs={"optimize": True})

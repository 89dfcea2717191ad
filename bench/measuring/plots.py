"""The plot of error against time: a panel for each view."""

import math

from .page import EXACT, NAMES, PEER_NAMES

COLORS = {"moments": "#1f6fb4", "octant": "#e07b00"}
PEER_MARKS = {"projected-tets": ("*", "#222222", 15), "ray-cast": ("D", "#8a2be2", 8)}


def _milliseconds(row):
    return 1e3 * row.frame_s


def _splats(panel, rows, color, kernel):
    def curve(of, style, size, label, **more):
        if of:
            x, y = [_milliseconds(row) for row in of], [row.rmse for row in of]
            panel.plot(x, y, style, color=color, markersize=size, label=label, **more)

    def by_tolerance(of):
        return sorted((row for row in of if row.tolerance is not None), key=lambda row: row.tolerance)

    usual = [row for row in rows if row.sort == "exact" and row.sampling == "auto"]
    curve(by_tolerance(usual), "o-", 5, f"{kernel}, by tolerance", linewidth=1.5)
    fixed = [row for row in usual if row.resolution is not None]
    curve(fixed, "o", 7, f"{kernel}, fixed resolutions", markerfacecolor="none")
    sampled = [row for row in rows if row.sampling == "4"]
    curve(sampled, "x", 5, f"{kernel}, samples 4 pixels apart")
    for row in by_tolerance(usual):
        if row.tolerance in (0, 1, 5, 20):
            label, at = "all" if row.tolerance == 0 else f"{row.tolerance:g} %", (_milliseconds(row), row.rmse)
            panel.annotate(label, at, xytext=(3, 5), textcoords="offset points", fontsize=8, color=color)


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

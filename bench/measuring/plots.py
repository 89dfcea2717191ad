"""Plots of error against time and splats: a panel for each view."""

import math

from .page import EXACT, NAMES, PEER_NAMES

COLORS = {"moments": "#1f6fb4", "octant": "#e07b00"}
PEER_MARKS = {"projected-tets": ("*", "#222222", 15), "ray-cast": ("D", "#8a2be2", 8)}


def _splats(panel, rows, x, y, color, kernel):
    usual = [row for row in rows if row.sort == "exact" and row.raster == "splats" and row.sampling == "auto"]
    sampled = [row for row in rows if row.sampling == "4"]
    by_tolerance = sorted((row for row in usual if row.tolerance is not None), key=lambda row: row.tolerance)
    panel.plot(
        [x(row) for row in by_tolerance],
        [row[y] for row in by_tolerance],
        "o-",
        color=color,
        markersize=5,
        linewidth=1.5,
        label=f"{kernel}, by tolerance",
    )
    mixed = sorted((row for row in rows if row.raster == "slabs"), key=lambda row: row.tolerance)
    if mixed:
        panel.plot(
            [x(row) for row in mixed],
            [row[y] for row in mixed],
            "s--",
            color=color,
            markersize=4,
            linewidth=1,
            label="slabs, by tolerance",
        )
    by_resolution = [row for row in usual if row.resolution is not None]
    panel.plot(
        [x(row) for row in by_resolution],
        [row[y] for row in by_resolution],
        "o",
        color=color,
        markersize=7,
        markerfacecolor="none",
        label=f"{kernel}, fixed resolutions",
    )
    if sampled:
        panel.plot(
            [x(row) for row in sampled],
            [row[y] for row in sampled],
            "x",
            color=color,
            markersize=5,
            label=f"{kernel}, samples 4 pixels apart",
        )
    for row in by_tolerance:
        if row.tolerance in (0, 1, 5, 20):
            panel.annotate(
                "all" if row.tolerance == 0 else f"{row.tolerance:g} %",
                (x(row), row[y]),
                xytext=(3, 5),
                textcoords="offset points",
                fontsize=8,
                color=color,
            )


def _peer(panel, row, x, y, kind, timed):
    mark, color, size = PEER_MARKS[kind]
    spread = [[1e3 * (row.frame_s - row.frame_min_s)], [1e3 * (row.frame_max_s - row.frame_s)]] if timed else None
    panel.errorbar(
        [x(row)], [row[y]], xerr=spread, fmt=mark, color=color, markersize=size, capsize=3, label=PEER_NAMES[kind]
    )


def _figure(results, x, x_label, y, y_label, timed, path):
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    columns = min(4, len(results.views) + 1)
    figure = Figure(figsize=(4.2 * columns, 3.9 * math.ceil((len(results.views) + 1) / columns)), layout="constrained")
    panels = figure.subplots(math.ceil((len(results.views) + 1) / columns), columns, squeeze=False).flatten()
    for panel, view in zip(panels, results.views):
        for kernel in results.kernels:
            rows = results.of(view=view, kernel=kernel, device=results.device)
            _splats(panel, rows, x, y, COLORS.get(kernel, "#2a9d4a"), kernel)
        for kind in PEER_NAMES:
            if peer := results.one(view=view, kernel=kind):
                _peer(panel, peer, x, y, kind, timed)
        if timed and (exact := results.one(view=view, kernel=EXACT)):  # its error is 0, which has no position here
            panel.axvline(x(exact), linestyle=":", color="#222222", label=NAMES[EXACT].replace("`", ""))
        panel.margins(0.1)
        panel.set(xscale="log", yscale="log", title=view, xlabel=x_label, ylabel=y_label)
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
    figure.savefig(path, dpi=100, metadata={"Software": None}, pil_kwargs={"optimize": True})


def draw(results, folder):
    """Writes the plots. Returns their names without .png."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()

    def milliseconds(row):
        return 1e3 * row.frame_s

    def splats(row):
        return row.splats

    plots = {
        "error-time": (milliseconds, "frame, ms", "rmse", "RMSE, linear RGB", True),
        "error-splats": (splats, "splats (VTK: cells)", "rmse", "RMSE, linear RGB", False),
    }
    if "flip" in results.note["extras"]:
        plots["flip-time"] = (milliseconds, "frame, ms", "flip", "mean FLIP", True)
    for name, arguments in plots.items():
        _figure(results, *arguments, folder / f"{name}.png")
    return list(plots)

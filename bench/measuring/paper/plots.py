"""Plots of error against splats."""

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402


def draw_error_curves(curves, path):
    """Draws a panel for each view, both axes logarithmic. `curves`: for (view, kernel, N) [(picture, splats, RMSE)]."""
    views = list(dict.fromkeys(view for view, _, _ in curves))
    leaves = list(dict.fromkeys(n for _, _, n in curves))
    figure, panels = pyplot.subplots(1, len(views), figsize=(9, 3), layout="constrained")
    for view, panel in zip(views, panels):
        for (of, kernel, n), curve in curves.items():
            if of != view:
                continue
            panel.plot(
                [splats for _, splats, _ in curve],
                [rmse for _, _, rmse in curve],
                marker="o" if kernel == "moments" else "x",
                markersize=4,
                linewidth=1,
                linestyle="-" if kernel == "moments" else "--",
                color=f"C{leaves.index(n)}",
                label=f"N = {n}" if kernel == "moments" else None,
            )
        panel.set(xscale="log", yscale="log", title=view, xlabel="splats")
        panel.grid(True, which="both", linewidth=0.3)
    panels[0].set_ylabel("RMSE (dashed: octant)")
    panels[-1].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)

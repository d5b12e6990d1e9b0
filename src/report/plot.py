#!/usr/bin/env python3
"""Draw the pictures of a report by pliant_report: python3 plot.py FOLDER [SETUP]

Reads the tables in FOLDER (of the last setup unless one is named) and writes

    tradeoff.png, tradeoff_refined.png   error against time per frame, with the Pareto front
    histogram.png                      per-voxel error in the warped image
    error_CASE_POINT_RATIO.png         slices of the per-voxel error
    stages.png                         cost of unused features
    validation.png                     measured bodies: distances of markers from their measured positions
    stability.png                      verdicts
"""
import csv
import math
import os
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import matplotlib.ticker
import numpy as np

CASES = ["displacement", "force", "grasp", "gravity", "sag"]
HIGHEST = 1000  # maximum of the axis in percent
VERDICTS = {"converged": "#8fc98f", "refused": "#9db8dd", "degraded": "#f0cf7a", "broken": "#e07a7a"}


def read(folder, name, setup=None):
    path = os.path.join(folder, name + ".csv")
    if not os.path.exists(path):
        return []
    with open(path, newline="") as file:
        return [row for row in csv.DictReader(file) if setup is None or row["setup"] == setup]


def number(row, column):
    try:
        return float(row[column])
    except (KeyError, ValueError):
        return math.nan


def method_of(row):
    return " ".join(filter(None, (row["method"], row["submesh"], row["variant"])))


def colours(names):
    palette = plt.get_cmap("tab10")
    return {name: palette(i % 10) for i, name in enumerate(names)}


def in_order(values):
    return list(dict.fromkeys(values))


def pareto(points):
    """Return the points (time, error) on the Pareto front, ordered by time."""
    front = []
    for time, error in sorted(points):
        if not front or error < front[-1][1]:
            front.append((time, error))
    return front


def label_log(axis, name, limits):
    """Use plain numbers on a logarithmic axis, also where it spans less than a decade."""
    axis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: "%g" % v))
    few = limits[1] < 10 * limits[0]
    axis.set_minor_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: "%g" % v) if few
                             else matplotlib.ticker.NullFormatter())
    axis.set_label_text(name)


def worst_of_points(rows, column):
    """Return one entry per method, ratio and budget: maximum error and median time over the pulled points."""
    groups = {}
    for row in rows:
        time, error = number(row, "solver_median_ms"), number(row, column)
        if math.isfinite(time) and math.isfinite(error) and time > 0 and error > 0:
            groups.setdefault((method_of(row), row["ratio"], row["budget"]), []).append((time, error))
    return {key: (float(np.median([t for t, _ in values])), max(e for _, e in values))
            for key, values in groups.items()}


def mark_choice(axis, choice, entries):
    """Mark the budget and the chosen point."""
    axis.axvline(number(choice, "budget_ms"), color="grey", linewidth=1, linestyle=":", zorder=0)
    method = method_of(choice)
    taken = [point for key, point in entries.items() if key[:2] == (method, choice["ratio"])
             and int(key[2]) <= int(choice["budget"])]
    if taken:
        axis.plot(*taken[-1], "*", markersize=20, markerfacecolor="none", color="black")


def draw_tradeoff(folder, rows, column, against, name, choice=None):
    cases = [case for case in CASES if any(row["case"] == case and math.isfinite(number(row, column)) for row in rows)]
    if not cases:
        return
    methods = in_order(method_of(row) for row in rows)
    ratios = in_order(row["ratio"] for row in rows)
    colour = colours(methods)
    marker = dict(zip(ratios, "osD^vP*X"))
    columns = min(2, len(cases))
    lines = -(-len(cases) // columns)
    figure, axes = plt.subplots(lines, columns, figsize=(7 * columns, 5 * lines + 1), squeeze=False)
    for axis, case in zip(axes.flat, cases):
        entries = worst_of_points([row for row in rows if row["case"] == case], column)
        for method in methods:
            for ratio in ratios:
                own = sorted((t, e, key[2]) for key, (t, e) in entries.items() if key[:2] == (method, ratio))
                if not own:
                    continue
                axis.plot([t for t, _, _ in own], [e for _, e, _ in own], marker[ratio], color=colour[method],
                          markersize=6, alpha=0.9)
                for time, error, budget in own:
                    if error > HIGHEST:
                        continue
                    axis.annotate("∞" if budget == "converged" else budget, (time, error), fontsize=7, xytext=(4, 3),
                                  textcoords="offset points", color=colour[method])
        axis.set_xscale("log")
        axis.set_yscale("log")
        errors = [e for _, e in entries.values()]
        axis.set_ylim(0.6 * min(errors), min(1.7 * max(errors), HIGHEST))
        for key, (time, error) in entries.items():
            if error > HIGHEST:  # out of range: draw at the upper edge
                axis.plot(time, HIGHEST, "2", color=colour[key[0]], markersize=9, clip_on=False)
        front = pareto(list(entries.values()))
        if front:
            axis.step([t for t, _ in front], [e for _, e in front], where="post", color="black", linewidth=1,
                      linestyle="--", zorder=0)
            axis.plot([t for t, _ in front], [e for _, e in front], "o", markersize=12, markerfacecolor="none",
                      color="black")
        if choice:
            mark_choice(axis, choice, entries)
        axis.set_title(case)
        label_log(axis.xaxis, "time per frame, without the volume: median [ms]", axis.get_xlim())
        which = {"max": "largest error", "p95": "95th percentile of the error",
                 "rms": "rms error"}[column.split("_")[-2]]
        label_log(axis.yaxis, which + ", worst frame\n[% of the largest displacement]", axis.get_ylim())
        axis.grid(True, which="both", alpha=0.25)
    for axis in list(axes.flat)[len(cases):]:
        axis.set_visible(False)
    handles = [plt.Line2D([], [], marker="o", linestyle="", color=colour[m], label=m) for m in methods]
    handles += [plt.Line2D([], [], marker=marker[r], linestyle="", color="grey", label="ratio " + r) for r in ratios]
    handles.append(plt.Line2D([], [], marker="o", linestyle="--", markerfacecolor="none", markersize=10, color="black",
                              label="Pareto front"))
    if choice:
        handles.append(plt.Line2D([], [], marker="*", linestyle=":", markerfacecolor="none", markersize=14,
                                  color="black", label="taken, budget"))
    figure.legend(handles=handles, loc="lower center", ncol=3 * columns, fontsize=9)
    figure.suptitle("Error against %s\n(numbers: iterations a step; ∞: until converged)" % against, fontsize=11)
    figure.tight_layout(rect=(0, 0.06 + 0.04 / lines, 1, 1 - 0.07 / lines))
    figure.savefig(os.path.join(folder, name), dpi=110)
    plt.close(figure)


def draw_histograms(folder, rows):
    groups = in_order((row["case"], row["point"], row["ratio"]) for row in rows)
    if not groups:
        return
    methods = in_order(method_of(row) for row in rows)
    colour = colours(methods)
    columns = min(2, len(groups))
    lines = -(-len(groups) // columns)
    figure, axes = plt.subplots(lines, columns, figsize=(7 * columns, 4 * lines + 0.5), squeeze=False)
    for axis, group in zip(axes.flat, groups):
        reached = 0
        for method in methods:
            own = [r for r in rows if (r["case"], r["point"], r["ratio"]) == group and method_of(r) == method]
            counts = np.array([number(r, "voxels") for r in own])
            if counts.sum() == 0:
                continue
            share = 100 * counts / counts.sum()
            edges = [number(r, "low_mm") for r in own] + [number(own[-1], "high_mm")]
            edges[-1] = edges[-2] + (edges[1] - edges[0])  # the last bin contains all larger values
            axis.step(edges, np.append(share, share[-1]), where="post", color=colour[method], linewidth=1.5,
                      label=method)
            reached = max(reached, edges[int(np.flatnonzero(share > 0.02).max()) + 1])
        axis.set_xlim(0, reached or 1)
        axis.set_yscale("log")
        axis.set_ylim(0.01, 120)
        axis.set_title("%s, ratio %s (last bin: all beyond)" % (" ".join(filter(None, group[:2])), group[2]),
                       fontsize=10)
        label_log(axis.yaxis, "share of the voxels of tissue [%]", axis.get_ylim())
        axis.set_xlabel("error [mm]")
        axis.grid(True, alpha=0.25)
    for axis in list(axes.flat)[len(groups):]:
        axis.set_visible(False)
    axes.flat[0].legend(fontsize=9)
    figure.suptitle("Per-voxel error in the warped image, last frame")
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.06 / lines))
    figure.savefig(os.path.join(folder, "histogram.png"), dpi=110)
    plt.close(figure)


def draw_slices(folder, rows):
    for group in in_order((row["case"], row["point"], row["ratio"]) for row in rows):
        own = [row for row in rows if (row["case"], row["point"], row["ratio"]) == group]
        methods, planes = in_order(method_of(row) for row in own), ["axial", "coronal", "sagittal"]
        slices = {(method_of(row), row["plane"]): row for row in own}
        errors = {key: 1e3 * np.load(os.path.join(folder, row["error_file"])) for key, row in slices.items()}
        largest = number(own[0], "largest_mm")
        # the colour scale fits the median method; larger errors saturate
        tops = sorted(float(np.percentile(e[e >= 0], 99.5)) for e in errors.values() if (e >= 0).any())
        top = max(min(tops[len(tops) // 2], largest), 1e-3) if tops else 1
        figure, axes = plt.subplots(len(methods), 3, figsize=(12, 3.4 * len(methods) + 0.5), squeeze=False,
                                    constrained_layout=True)
        scale = plt.cm.ScalarMappable(norm=plt.Normalize(0, top), cmap="inferno")
        scale.set_array([])
        for line, method in enumerate(methods):
            for axis, plane in zip(axes[line], planes):
                row = slices.get((method, plane))
                axis.set_axis_off()
                if row is None:
                    continue
                image, error = np.load(os.path.join(folder, row["image_file"])), errors[method, plane]
                low, high = (-160, 240) if image.min() < -500 else np.percentile(image, (1, 99))
                aspect = number(row, "row_mm") / number(row, "column_mm")
                axis.imshow(image, cmap="gray", vmin=low, vmax=high, aspect=aspect)
                overlay = scale.to_rgba(error)
                overlay[..., 3] = np.clip(error / top, 0, 1) ** 0.5 * 0.85  # small errors stay transparent
                axis.imshow(overlay, aspect=aspect)
                axis.set_title("%s, %s" % (method, plane), fontsize=9)
        figure.colorbar(scale, ax=axes, label="error [mm]; largest displacement %.1f mm" % largest, shrink=0.7)
        figure.suptitle("Per-voxel error, %s, ratio %s" % (" ".join(filter(None, group[:2])), group[2]))
        name = "error_%s.png" % "_".join(filter(None, group)).replace(" ", "-")
        figure.savefig(os.path.join(folder, name), dpi=90)
        plt.close(figure)


def draw_stages(folder, rows):
    if not rows:
        return
    names = [{"nothing": "nothing omitted",
              "everything": "all omitted"}.get(row["omitted"], "without " + row["omitted"]) for row in rows]
    figure, axes = plt.subplots(1, 2, figsize=(11, 0.45 * len(rows) + 1.6), sharey=True)
    for axis, column, unit in zip(axes, ("frame_median_ms", "held_mb"),
                                  ("frame, median [ms]", "memory in addition to the model [MB]")):
        values = [number(row, column) for row in rows]
        axis.barh(range(len(rows)), values, color=["#555555"] + ["#4c78a8"] * (len(rows) - 1))
        for y, value in enumerate(values):
            axis.annotate("%.3g" % value, (value, y), xytext=(3, 0), textcoords="offset points", va="center",
                          fontsize=8)
        axis.set_xlim(0, 1.15 * max(values))
        axis.set_xlabel(unit)
    axes[0].set_yticks(range(len(rows)))
    axes[0].set_yticklabels(names)
    axes[0].invert_yaxis()
    figure.suptitle("Omitted parts")
    figure.tight_layout(rect=(0, 0, 1, 0.94))
    figure.savefig(os.path.join(folder, "stages.png"), dpi=110)
    plt.close(figure)


def draw_validation(folder, rows):
    if not rows:
        return
    figure, axis = plt.subplots(figsize=(8, 0.5 * len(rows) + 1.8))
    for y, row in enumerate(rows):
        fitted = row["role"] == "fitted"
        axis.barh(y, number(row, "rms_mm"), color="#9ecae9" if fitted else "#4c78a8", height=0.6)
        axis.plot(number(row, "max_mm"), y, "|", color="#555555", markersize=12)
        spread, deviation = number(row, "spread_mm"), number(row, "deviation_mm")
        axis.plot([spread], [y], "o", color="#e45756", label="spread of the measurement" if y == 0 else None)
        axis.plot([deviation], [y], "D", color="#f58518", markersize=5,
                  label="reported deviation" if y == 0 else None)
        axis.annotate("%.2f mm of %.1f (%.0f %%)" % (number(row, "rms_mm"), number(row, "moved_rms_mm"),
                                                     number(row, "percent")),
                      (np.nanmax([number(row, "max_mm"), spread, deviation]), y), xytext=(8, 0),
                      textcoords="offset points", va="center", fontsize=8)
    axis.set_yticks(range(len(rows)))
    axis.set_yticklabels(["%s, %s: %s" % (row["body"], row["state"], row["role"]) for row in rows], fontsize=8)
    axis.invert_yaxis()
    axis.set_xlim(0, 1.6 * max(max(number(row, "max_mm") for row in rows),
                               max(np.nan_to_num(number(row, "deviation_mm")) for row in rows)))
    axis.set_xlabel("simulated from measured: root mean square (bar) and largest (tick) [mm]")
    axis.legend(loc="upper right", bbox_to_anchor=(1, -0.18), ncol=2, fontsize=8)
    fits = in_order("%s: %s" % (row["body"], row["fitted"]) for row in rows)
    figure.suptitle("Fitted on one state, predicted in the others\n" + "\n".join(fits), fontsize=10)
    figure.tight_layout()
    figure.savefig(os.path.join(folder, "validation.png"), dpi=110)
    plt.close(figure)


def draw_stability(folder, rows):
    if not rows:
        return
    methods = in_order(row["method"] for row in rows)
    lines = in_order((row["case"], row["parameter"]) for row in rows)
    cells = {(row["case"], row["parameter"], row["method"]): row for row in rows}
    figure, axis = plt.subplots(figsize=(4.5 + 1.6 * len(methods), 0.24 * len(lines) + 1.4))
    for y, line in enumerate(lines):
        for x, method in enumerate(methods):
            row = cells.get(line + (method,))
            if row is None:
                continue
            axis.add_patch(plt.Rectangle((x, y), 1, 1, facecolor=VERDICTS[row["verdict"]], edgecolor="white"))
            steps = row["steps_to_rest"]
            text = row["verdict"] + (", %s" % steps if steps not in ("", "-1") else "")
            axis.text(x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=7)
    axis.set_xlim(0, len(methods))
    axis.set_ylim(len(lines), 0)
    axis.set_xticks([x + 0.5 for x in range(len(methods))])
    axis.set_xticklabels(methods)
    axis.set_yticks([y + 0.5 for y in range(len(lines))])
    axis.set_yticklabels(["%s: %s" % (c.replace("_", " "), p) for c, p in lines], fontsize=8)
    axis.tick_params(length=0)
    axis.xaxis.tick_top()
    axis.set_title("Stability: verdict, and steps until the body is at rest again", fontsize=10)
    figure.tight_layout()
    figure.savefig(os.path.join(folder, "stability.png"), dpi=110)
    plt.close(figure)


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    folder = sys.argv[1]
    sweep = read(folder, "sweep")
    setup = sys.argv[2] if len(sys.argv) > 2 else (sweep[-1]["setup"] if sweep else "")
    sweep = [row for row in sweep if row["setup"] == setup]
    choice = (read(folder, "choice", setup) or [None])[0]
    against = "on %s tetrahedra" % choice["reference_tetrahedra"] if choice else "at the same resolution"
    column = (choice["measure"] if choice else "max") + "_percent"
    draw_tradeoff(folder, sweep, column, "the fine solution " + against, "tradeoff.png", choice)
    draw_tradeoff(folder, sweep, "refined_max_percent", "the fine solution at twice the resolution",
                  "tradeoff_refined.png")
    draw_histograms(folder, read(folder, "histogram", setup))
    draw_slices(folder, read(folder, "slices", setup))
    draw_stages(folder, read(folder, "stages", setup))
    draw_validation(folder, read(folder, "validation"))
    draw_stability(folder, read(folder, "stability"))


if __name__ == "__main__":
    main()

"""What the commands of objective evaluation print: a report in lines, and where its page lies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

SHOWN_OF_CLOUDS = ("d1_psnr_db", "d2_psnr_db", "chamfer", "f_score", "y_psnr_db", "pointssim_colour")


def cloud_sentences(report: dict[str, Any], page: Path) -> str:
    """Print each approach's quality as a cloud."""
    from recon.validation.cloud_quality.evaluation import SOURCE
    from recon.validation.cloud_quality.report import mean_values, skipped_sentences

    lines = []
    for name in dict.fromkeys(value["approach"] for value in report["values"]):
        shown = [
            f"{value['measure']} {float(value['value']):.4g}{' ' * bool(value['unit'])}{value['unit']}"
            for value in mean_values(report)
            if value["approach"] == name and (value["measure"] in SHOWN_OF_CLOUDS or value["source"] != SOURCE)
        ]
        lines.append(f"{name}: {', '.join(shown) or 'see measures.csv'}")
    lines += [f"remark: {remark}" for remark in report["remarks"]] + skipped_sentences(report["skipped"])
    return "\n".join([*lines, f"Report: {page}"])


def view_sentences(report: dict[str, Any], page: Path) -> str:
    """Print how rendered views compare with photographs, and sensors with each other."""
    threshold = report["settings"]["threshold_mm"]
    lines = [
        f"{row['kind']}, {row['approach']}: "
        + ", ".join(
            f"{name} {row[column]:{form}}"
            for name, column, form in (
                ("PSNR", "psnr_db", ".2f"),
                ("SSIM", "ssim", ".3f"),
                ("coverage", "coverage", ".1%"),
                ("spill", "spill", ".1%"),
            )
            if row[column] is not None
        )
        for row in report["means"]
        if row["region"] == "all"
    ]
    lines += [
        f"sensors by {row['depth']}: {row['agree']:.1%} of the depths agree within {threshold:.3g} mm"
        for row in report["agreement"]
        if row["agree"] is not None
    ]
    return "\n".join([*lines, f"Report: {page}"])


def film_sentences(report: dict[str, Any], page: Path) -> str:
    """Print each film's measures."""
    lines: dict[str, list[str]] = {}
    for row in report["films"]:
        value = "infinite" if row["mean"] is None else f"{row['mean']:.4g}"
        lines.setdefault(f"{row['dataset']}/{row['approach']}", []).append(f"{row['measure']} {value}")
    remarks = [f"remark: {remark}" for remark in report["remarks"]]
    return "\n".join([*(f"{film}: {', '.join(values)}" for film, values in lines.items()), *remarks, f"Report: {page}"])


def cuboid_sentences(report: dict[str, Any], page: Path) -> str:
    """Print each cuboid's angles and edges."""
    lines = []
    for row in report["reconstructions"]:
        if row["failure"]:
            lines.append(f"no fit: {row['name']}: {row['failure']}")
            continue
        angles, edges = (
            ", ".join(f"{error[column]:+.3g}" for error in report[part] if error["name"] == row["name"])
            for part, column in (("angles", "error_deg"), ("edges", "error_mm"))
        )
        faces = f"faces {' '.join(row['faces'])}"
        lines.append(f"{row['name']}: {faces}; angles off by {angles} degrees, edges by {edges} mm")
    return "\n".join([*lines, f"Report: {page}"])


def sphere_sentences(report: dict[str, Any], page: Path) -> str:
    """Print the inliers of each sensor, and what was left out."""
    lines = [
        f"{row['sensor']} ({row['subset']}): {row['inliers']:.2%} within {row['threshold_mm']:g} mm "
        f"in {row['n_samples']} samples"
        for row in report["table"]
    ]
    lines += [f"left out: {row['name']}: {'; '.join(row['reasons'])}" for row in report["excluded"]]
    lines += [
        f"remark: {row['name']}: {'; '.join(row['remarks'])}" for row in report["reconstructions"] if row["remarks"]
    ]
    failed = {row["name"]: row["failure"] for row in report["reconstructions"] if row["failure"]}
    if report["reference"]:
        from recon.validation.sphere.report import reference_text

        lines.append(f"reference: {reference_text(report['reference'])}")
    return "\n".join([*lines, *(f"no fit: {name}: {why}" for name, why in failed.items()), f"Report: {page}"])

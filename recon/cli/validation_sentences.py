"""What the commands of objective evaluation print of a report, line by line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from recon.cli.console import counted

SHOWN_OF_CLOUDS = ("d1_psnr_db", "d2_psnr_db", "chamfer", "f_score", "y_psnr_db", "pointssim_colour")


def cloud_sentences(report: Mapping[str, Any]) -> list[str]:
    """List each approach's quality as a cloud."""
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
    return [*lines, *(f"remark: {remark}" for remark in report["remarks"]), *skipped_sentences(report["skipped"])]


def view_sentences(report: Mapping[str, Any]) -> list[str]:
    """List how rendered views compare with photographs, and sensors with each other."""
    threshold = report["settings"]["threshold_mm"]
    lines = [
        f"{row['kind']}, {row['approach']}: "
        + ", ".join(
            f"{name} {row[column]:{form}}"
            for name, column, form in (
                ("PSNR", "psnr_db", ".2f"),
                ("PSNR of the object", "psnr_object_db", ".2f"),
                ("SSIM", "ssim", ".3f"),
                ("coverage", "coverage", ".1%"),
                ("spill", "spill", ".1%"),
                ("back faces", "back_faces", ".1%"),
            )
            if row[column] is not None
        )
        for row in report["means"]
        if row["region"] == "all"
    ]
    return lines + [
        f"sensors by {row['depth']}: {row['agree']:.1%} of the depths agree within {threshold:.3g} mm"
        for row in report["agreement"]
        if row["agree"] is not None
    ]


def film_sentences(report: Mapping[str, Any]) -> list[str]:
    """List each film's measures."""
    lines: dict[str, list[str]] = {}
    for row in report["films"]:
        value = "infinite" if row["mean"] is None else f"{row['mean']:.4g}"
        lines.setdefault(f"{row['dataset']}/{row['approach']}", []).append(f"{row['measure']} {value}")
    remarks = [f"remark: {remark}" for remark in report["remarks"]]
    return [*(f"{film}: {', '.join(values)}" for film, values in lines.items()), *remarks]


def cuboid_sentences(report: Mapping[str, Any]) -> list[str]:
    """List each cuboid's angles and edges."""
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
    return lines


def sphere_sentences(report: Mapping[str, Any]) -> list[str]:
    """List the inliers of each sensor, and what was left out."""
    lines = [
        f"{row['sensor']} ({row['subset']}): {row['inliers']:.2%} within {row['threshold_mm']:g} mm "
        f"in {counted(row['n_samples'], 'sample')}"
        for row in report["table"]
    ]
    lines += [f"remark: {remark}" for remark in report["sensor_remarks"]]
    lines += [f"left out: {row['name']}: {'; '.join(row['reasons'])}" for row in report["excluded"]]
    lines += [
        f"remark: {row['name']}: {'; '.join(row['remarks'])}" for row in report["reconstructions"] if row["remarks"]
    ]
    if report["reference"]:
        from recon.validation.sphere.report import reference_text

        lines.append(f"reference: {reference_text(report['reference'])}")
    return lines + [f"no fit: {row['name']}: {row['failure']}" for row in report["reconstructions"] if row["failure"]]


def object_sentences(report: Mapping[str, Any]) -> list[str]:
    """List how much of the cloud lies on the model, and whether it fits elsewhere as well."""
    from recon.validation.known_object.report import ambiguity_text

    registration, row = report["registration"], report["table"][0]
    sentence = (
        f"{registration['overlap']:.1%} of the cloud within {registration['delta_mm']:.3g} mm of the model; "
        f"{row['inliers']:.2%} within {row['threshold_mm']:g} mm"
    )
    return [sentence, *([ambiguity_text(report)] if registration["is_ambiguous"] else [])]


def mesh_sentences(report: Mapping[str, Any]) -> list[str]:
    """List the mean distances from and to the truth, the F-score at the threshold of the table, and the remarks."""
    threshold = report["settings"]["table_threshold_mm"]
    score = next(row for row in report["scores"] if row["threshold_mm"] == threshold)
    return [
        f"accuracy {report['accuracy']['mean_mm']:.3g} mm, completeness {report['completeness']['mean_mm']:.3g} mm, "
        f"F-score {score['f_score']:.2%} at {threshold:g} mm",
        *(f"remark: {remark}" for remark in report["remarks"]),
    ]

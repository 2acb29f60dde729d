"""Commands about plans and what they are made of; no vehicle is needed."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="Folder to write the plan into.")
def plan(scenario: Path, out: Path) -> None:
    """Plan the inspection that SCENARIO (YAML or JSON) asks for."""
    from gcs.services.plan_service import plan_to_directory
    from gcs.services.terminal import TerminalProgress

    with TerminalProgress() as progress:
        result = plan_to_directory(scenario, out, progress)
    from gcs.services.plan_writing import WrittenPlan  # there by now

    for note in result.notes:
        click.echo(f"note: {note}")
    if not isinstance(result, WrittenPlan):
        for line in result.document.lines():
            click.echo(line)
        click.echo(f"written to {out}")
        return
    c = result.plan.certificates
    seen = "" if c.coverage is None else f", {c.coverage:.1%} of the coverable surface"
    least = f" (no choice has fewer than {c.viewpoints_lower_bound:.1f})" if c.viewpoints_lower_bound else ""
    click.echo(f"{c.viewpoints} viewpoints{least}{seen}")
    for face in result.plan.faces:
        click.echo(f"face {face.name}: {face.covered} of {face.cells} cells, {len(face.moved)} of them from aside")
    click.echo(
        f"{c.length_m:.1f} m in {c.duration_s:.0f} s, {c.energy_wh:.0f} Wh, hull clearance {c.min_clearance_m:.2f} m"
    )
    for prediction in result.report["predictions"]:
        click.echo(f"on {prediction['autopilot']}: {prediction['why']}")
    for number, sortie in enumerate(result.plan.sorties, start=1):
        views, seconds, energy = len(sortie.viewpoints), sortie.duration_s, sortie.energy_wh
        click.echo(f"sortie {number}: {views} viewpoints in {seconds:.0f} s, {energy:.0f} Wh")
    click.echo(f"written to {out}")


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--points",
    type=click.Path(path_type=Path),
    help="Also say which points of this CSV (x_m,y_m,z_m,normal_x,normal_y,normal_z) are seen, and why not the others.",
)
def verify(out: Path, points: Path | None) -> None:
    """Check the written plan in OUT again, from its files and meshes alone."""
    from gcs.services.plan_verification import verify_plan

    checks = verify_plan(out)
    for check in checks:
        click.echo(f"{'ok  ' if check.ok else 'FAIL'}  {check.name}: {check.message}")
    if points is not None:
        from gcs.services.point_verdicts import judge_points

        for point in judge_points(out, points):
            click.echo(f"{point.name}: {point.verdict.words}")
    if not all(check.ok for check in checks):
        sys.exit(1)


@click.command(name="inspect-mesh")
@click.argument("file", type=click.Path(path_type=Path))
def inspect_mesh(file: Path) -> None:
    """Say what the mesh in FILE is like."""
    from gcs.services.mesh_report import inspect_mesh as report

    for line in report(file).lines():
        click.echo(line)

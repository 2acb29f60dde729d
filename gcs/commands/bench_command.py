"""The command that measures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from gcs.commands.shared_options import json_option


@click.command()
@click.argument("name", required=False)
@click.option("--quick", is_flag=True, help="A small version of the same, in seconds.")
@click.option("--mesh", type=click.Path(path_type=Path), help="A mesh of your own (coverage).")
@click.option("--records", type=click.Path(path_type=Path), help="A folder of recorded flights (predictions).")
@json_option
def bench(name: str | None, quick: bool, mesh: Path | None, records: Path | None, as_json: bool) -> None:
    """List the benchmarks, or run the one called NAME."""
    from gcs.services.benchmarks.registry import list_benchmarks, run_benchmark

    if name is None:
        for known, about in list_benchmarks().items():
            click.echo(f"{known:14s} {about}")
        return
    result: dict[str, Any] = run_benchmark(name, quick=quick, mesh=mesh, records=records)
    if not as_json:
        for row in result["rows"]:
            reference = "" if row["reference_value"] is None else f"   {row['reference']} {row['reference_value']:.6g}"
            click.echo(f"{row['case']:28s} {row['figure']:16s} {row['value']:.6g} {row['unit']}{reference}")
    click.echo(json.dumps(result) if as_json else "")

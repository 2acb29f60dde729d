"""A process that reads a vehicle's mission with MAVSDK and prints it as one JSON line.

Usage: mavsdk_download.py PORT
"""

from __future__ import annotations

import json
import sys

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw


def main() -> None:
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
    system = sdk.first_autopilot(20.0)
    items = MissionRaw(system).download_mission()
    rows = [
        [i.seq, i.frame, i.command, i.param1, i.param2, i.param3, i.param4, i.x, i.y, i.z, i.autocontinue]
        for i in items
    ]
    print(json.dumps({"items": rows}), flush=True)


if __name__ == "__main__":
    main()

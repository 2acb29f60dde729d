"""A process that plays an autopilot with MAVSDK: it takes missions and serves files. Prints one JSON line a mission.

Usage: mavsdk_server.py PORT FOLDER: sends to UDP PORT of this machine, serves FOLDER.
"""

from __future__ import annotations

import json
import sys
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.ftp_server import FtpServer
from mavsdk.plugins.mission_raw_server import MissionRawServer


def main() -> None:
    port, folder = int(sys.argv[1]), sys.argv[2]
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
    sdk.add_any_connection(f"udpout://127.0.0.1:{port}")
    component = sdk.server_component()
    files = FtpServer(component)
    files.set_root_dir(folder)
    missions = MissionRawServer(component)

    def incoming(result, plan, _):
        items = [
            [i.seq, i.frame, i.command, i.param1, i.param2, i.param3, i.param4, i.x, i.y, i.z, i.autocontinue]
            for i in plan.mission_items
        ]
        print(json.dumps({"result": int(result), "items": items}), flush=True)

    missions.subscribe_incoming_mission(incoming)
    print("ready", flush=True)
    while True:
        time.sleep(1)


if __name__ == "__main__":
    main()

"""A process that is a ground station made with MAVSDK: writes a mission, reads it back, prints both as JSON.

Usage: mavsdk_client.py PORT KIND: listens on UDP PORT of this machine.
"""

from __future__ import annotations

import json
import sys
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw


def mission(kind: str) -> list[MissionItem]:
    """Items that the vehicle keeps as they are."""
    x, y = 313622000, 1216155000
    first = (3, 22, x, y, 10.0) if kind == "ardupilot" else (6, 22, x, y, 10.0)
    rows = [first, (first[0], 16, x + 1000, y, 12.0), (first[0], 16, x, y + 1000, 14.5), (first[0], 21, x, y, 0.0)]
    if kind == "ardupilot":
        rows.insert(0, (0, 16, 0, 0, 0.0))
    return [
        MissionItem(
            seq=i, frame=f, command=c, current=int(i == 0), autocontinue=1, param1=0.0, param2=0.0, param3=0.0,
            param4=0.0, x=x, y=y, z=z, mission_type=0,
        )
        for i, (f, c, x, y, z) in enumerate(rows)
    ]  # fmt: skip


def row(item: MissionItem) -> list[float]:
    """What is compared of an item."""
    numbers = [item.param1, item.param2, item.param3, item.param4, item.z]
    return [item.seq, item.frame, item.command, item.x, item.y, *(round(n, 3) for n in numbers)]


def main() -> None:
    """Connect, write, read back."""
    port, kind = int(sys.argv[1]), sys.argv[2]
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = sdk.first_autopilot(30.0)
    if system is None:
        raise SystemExit("no autopilot was found")
    time.sleep(1.5)  # ArduPilot's storage opens a little after its first heartbeat
    raw = MissionRaw(system)
    items = mission(kind)
    raw.upload_mission(items)
    back = raw.download_mission()
    skip = 1 if kind == "ardupilot" else 0  # item 0 is home there
    sent_rows, back_rows = [row(i) for i in items], [row(i) for i in back]
    print(json.dumps({"sent": [None] * skip + sent_rows[skip:], "back": [None] * skip + back_rows[skip:]}), flush=True)


if __name__ == "__main__":
    main()

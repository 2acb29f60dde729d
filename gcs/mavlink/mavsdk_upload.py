"""Uploads with MAVSDK's client, as a process of its own: what our transfers are measured beside.

Usage: python -m gcs.mavlink.mavsdk_upload PORT: listens on UDP PORT of this machine, reads the items as JSON from
standard input, sends them once, prints one JSON line with `ok` and `seconds`.
"""

from __future__ import annotations

import json
import sys
import time

_FOUND_WITHIN_S = 30.0


def main() -> None:
    """Connect, send, report."""
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

    items = [
        MissionItem(
            seq=sequence,
            frame=frame,
            command=command,
            current=int(sequence == 0),
            autocontinue=autocontinue,
            param1=p1,
            param2=p2,
            param3=p3,
            param4=p4,
            x=x,
            y=y,
            z=z,
            mission_type=0,
        )
        for sequence, (frame, command, p1, p2, p3, p4, x, y, z, autocontinue) in enumerate(json.load(sys.stdin))
    ]
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
    system = sdk.first_autopilot(_FOUND_WITHIN_S)
    if system is None:
        raise SystemExit("no autopilot was found")
    transfers = MissionRaw(system)
    begin = time.perf_counter()
    try:
        transfers.upload_mission(items)
        ok = True
    except Exception:  # whatever its reason, the upload did not succeed
        ok = False
    print(json.dumps({"ok": ok, "seconds": time.perf_counter() - begin}), flush=True)


if __name__ == "__main__":
    main()

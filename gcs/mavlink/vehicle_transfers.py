"""What one vehicle holds and is asked for: missions, parameters, files, position references and plans."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable, Sequence

from gcs.core.errors import LinkError, RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.mission import Mission, MissionItem
from gcs.core.progress import Progress
from gcs.core.vehicle import Autopilot, Failsafe, ReplanReport, VehicleIdentity, VehicleLimits
from gcs.mavlink.canonical_form import MissionComparison
from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.ftp_directory import DirectoryListing, ListDirectory
from gcs.mavlink.ftp_fetch import FetchedFile, FetchFile, PartialFile
from gcs.mavlink.ftp_protocol import SequenceNumbers, path_from_url
from gcs.mavlink.message_rates import request_call
from gcs.mavlink.mission_clear import MissionClear
from gcs.mavlink.mission_proof import (
    MissionPeer,
    UploadProof,
    compare_with_vehicle,
    download,
    upload_and_prove,
    upload_list_and_prove,
)
from gcs.mavlink.mission_protocol import ListUnsupportedError, MissionType
from gcs.mavlink.parameter_protocol import ParameterRead, ParameterReading, ParameterSet
from gcs.mavlink.replan_tunnel import PlanAnnouncement, ReportStatus, report_ack
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_state import VehicleState

ASK_EVERY_S = 0.7
LIST_CAPABILITY = {
    MissionType.FENCE: mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE,
    MissionType.RALLY: mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY,
}


class VehicleTransfers(VehicleState):
    """The half of a `Vehicle` that moves data and commands nothing to move."""

    def __init__(self, identity: VehicleIdentity, channel: VehicleChannel, *, lost_after_s: float) -> None:
        super().__init__(identity, channel, lost_after_s=lost_after_s)
        self._file_numbers: dict[int, SequenceNumbers] = {}
        self._file_lock = asyncio.Lock()
        self._mission_lock = asyncio.Lock()
        self._absent_lists: set[MissionType] = set()
        self._parameter_lock = asyncio.Lock()

    async def upload_mission(self, mission: Mission, progress: Progress | None = None) -> UploadProof:
        """Put a mission on it and prove it by reading it back."""
        async with self._mission_lock:
            return await self._named(upload_and_prove(mission, self._mission_peer(), progress))

    async def download_mission(self, progress: Progress | None = None) -> tuple[MissionItem, ...]:
        """Read the mission that it holds."""
        async with self._mission_lock:
            return await self._named(download(self._mission_peer(), progress))

    async def compare_with_vehicle(self, mission: Mission, progress: Progress | None = None) -> MissionComparison:
        """Read the mission that it holds and compare, in its canonical form."""
        async with self._mission_lock:
            return await self._named(compare_with_vehicle(mission, self._mission_peer(), progress))

    async def clear_mission(self) -> None:
        """Remove the mission that it holds."""
        await self.clear_list(MissionType.MISSION)

    async def upload_list(
        self, items: Sequence[MissionItem], mission_type: MissionType, progress: Progress | None = None
    ) -> UploadProof:
        """Replace its fence or its rally points and prove it by reading them back.

        Raises:
            ListUnsupportedError: it keeps no such list.
            RefusedError: it does not take the items.
            LinkError: it does not answer; what it holds is unknown.
        """
        self._demand_list(mission_type)
        async with self._mission_lock, self._remembering(mission_type):
            return await self._named(upload_list_and_prove(items, mission_type, self._mission_peer(), progress))

    async def download_list(
        self, mission_type: MissionType, progress: Progress | None = None
    ) -> tuple[MissionItem, ...]:
        """Read its fence or its rally points; errors as those of `upload_list`."""
        self._demand_list(mission_type)
        async with self._mission_lock, self._remembering(mission_type):
            return await self._named(download(self._mission_peer(), progress, mission_type))

    async def clear_list(self, mission_type: MissionType) -> None:
        """Empty one of its lists; errors as those of `upload_list`."""
        self._demand_list(mission_type)
        async with self._mission_lock:
            clear = MissionClear(
                *self._channel.target,
                self._channel.send,
                self._now,
                mission_type,
                own_system=self._channel.sender[0],
            )
            await self._named(self._channel.run(clear))

    def keeps_list(self, mission_type: MissionType) -> bool:
        """Whether it keeps such a list, by its capabilities and its answers; True as long as it has not said no."""
        flag = LIST_CAPABILITY.get(mission_type, 0)
        by_capabilities = self.capabilities is None or not flag or bool(self.capabilities & flag)
        return by_capabilities and mission_type not in self._absent_lists

    def _demand_list(self, mission_type: MissionType) -> None:
        """Do not even ask a vehicle that has said that it has no such list."""
        if not self.keeps_list(mission_type):
            raise ListUnsupportedError(f"the vehicle keeps no {mission_type.noun}", field=self.identity.name)

    @contextlib.asynccontextmanager
    async def _remembering(self, mission_type: MissionType) -> AsyncIterator[None]:
        try:
            yield
        except ListUnsupportedError:
            self._absent_lists.add(mission_type)
            raise

    async def read_parameters(self, names: Iterable[str]) -> dict[str, float | None]:
        """Read parameters by name; None where it did not tell one."""
        readings = await self._read(names)
        return {name: None if reading is None else reading.value for name, reading in readings.items()}

    async def set_parameter(self, name: str, value: float) -> float:
        """Set a parameter; returns the value that it tells afterwards.

        Raises:
            RefusedError: it has no such parameter, or keeps another value.
            InputError: the value does not fit the parameter's type.
        """
        reading = (await self._read([name]))[name]
        if reading is None:
            raise RefusedError(f"it has no parameter {name}", field=self.identity.name)
        async with self._parameter_lock:
            change = ParameterSet(
                name,
                value,
                reading.parameter_type,
                target=self._channel.target,
                bytewise=self._bytewise,
                send=self._channel.send,
                clock=self._now,
            )
            return await self._named(self._channel.run(change))

    async def read_limits(self) -> VehicleLimits:
        """What its parameters allow."""
        return self._stack.limits(await self.read_parameters(self._stack.limit_parameters))

    async def set_return_altitude(self, altitude_m: float) -> str:
        """Set the height above home at which its own return flies, and see that it keeps it.

        Returns:
            The parameter and its value as it tells it afterwards, such as `RTL_ALT = 5400`.

        Raises:
            RefusedError: it does not take it.
            LinkError: it does not answer.
        """
        setting = self._stack.return_altitude_setting(altitude_m)
        if setting is None:
            raise RefusedError("its return altitude cannot be set", field=self.identity.name)
        return f"{setting[0]} = {await self.set_parameter(*setting):g}"

    async def read_failsafes(self) -> tuple[Failsafe, ...]:
        """How its failsafes are set up."""
        return self._stack.failsafes(await self.read_parameters(self._stack.failsafe_parameters))

    async def request_position_references(self, timeout_s: float = 5.0) -> tuple[GeoPoint, GeoPoint]:
        """Ask for HOME_POSITION and GPS_GLOBAL_ORIGIN anew; returns home and origin.

        Raises:
            LinkError: it did not tell both in time: it may have no position fix yet.
        """
        asked_at = self._now()
        wanted = {
            "home": mavlink.MAVLINK_MSG_ID_HOME_POSITION,
            "origin": mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
        }
        next_ask = asked_at

        def fresh() -> bool:
            nonlocal next_ask
            missing = [number for name, number in wanted.items() if not self._heard_since(name, asked_at)]
            if missing and self._now() >= next_ask:
                next_ask = self._now() + ASK_EVERY_S
                for number in missing:
                    self._channel.send(command_long(request_call(number), self._channel.target, 0))
            return not missing

        await self.until(fresh, timeout_s, "its home and origin (it may have no position fix yet)")
        home, origin = self.telemetry.home, self.telemetry.origin
        if home is None or origin is None:
            raise LinkError("it did not tell its home and origin", field=self.identity.name)
        return home.value, origin.value

    async def list_files(self, path: str, component: int | None = None) -> DirectoryListing:
        """List a folder of its camera, or of another component that serves files."""
        async with self._file_lock:
            folder, system, server, numbers = self._file_server(path, component)
            listing = ListDirectory(
                folder,
                system,
                server,
                self._channel.send,
                self._now,
                sequence=numbers,
                own_system=self._channel.sender[0],
            )
            return await self._named(self._channel.run(listing))

    async def fetch_file(
        self,
        path: str,
        progress: Progress | None = None,
        *,
        component: int | None = None,
        resume: PartialFile | None = None,
    ) -> FetchedFile:
        """Read a file of its camera, or of another component; one at a time, others wait.

        Args:
            path: of the file, or its `mftp:` address as an ImageReport has it.
            progress: told under the path's name.
            component: that serves it; by default the one that the address names, else the camera, else the autopilot.
            resume: what an earlier try left (`partial` of its error).
        """

        def tell(done: int, total: int) -> None:
            if progress is not None:
                progress.report(path, done / max(total, 1))

        async with self._file_lock:
            file, system, server, numbers = self._file_server(path, component)
            fetch = FetchFile(
                file,
                system,
                server,
                self._channel.send,
                self._now,
                sequence=numbers,
                own_system=self._channel.sender[0],
                resume=resume,
                on_progress=tell,
            )
            return await self._named(self._channel.run(fetch))

    async def announce_plan(self, plan_hash: str) -> bool:
        """Tell it the SHA-256 of the plan that it is to fly; False when it does not know of plans."""
        system, component = self._channel.target
        announcement = PlanAnnouncement(plan_hash, system, component, self._channel.send, self._now)
        return await self._channel.run(announcement)

    def acknowledge_replan(self, report: ReplanReport, *, stored: bool = True) -> None:
        """Answer a ReplanEvent, once its report is in the store (or refused for good)."""
        status = ReportStatus.STORED if stored else ReportStatus.REFUSED
        self._channel.send(report_ack(report.boot_id, report.number, status, *self._channel.target))

    async def _read(self, names: Iterable[str]) -> dict[str, ParameterReading | None]:
        async with self._parameter_lock:
            read = ParameterRead(
                names,
                target=self._channel.target,
                bytewise=self._bytewise,
                send=self._channel.send,
                clock=self._now,
            )
            return await self._named(self._channel.run(read))

    @property
    def _bytewise(self) -> bool:
        if self.identity.autopilot is Autopilot.GENERIC and self.capabilities is not None:
            return bool(self.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)
        return self._stack.bytewise_parameters

    def _mission_peer(self) -> MissionPeer:
        system, component = self._channel.target
        return MissionPeer(
            target_system=system,
            target_component=component,
            autopilot=self.identity.autopilot,
            send=self._channel.send,
            clock=self._now,
            run=self._channel.run,
            own_system=self._channel.sender[0],
        )

    def _file_server(self, path: str, component: int | None) -> tuple[str, int, int, SequenceNumbers]:
        """Bare path, system, component and request numbers of the server that has a file."""
        bare, named = path_from_url(path)
        server = component or named or self.camera_component or self.identity.component_id
        numbers = self._file_numbers.setdefault(server, SequenceNumbers())
        return bare, self.identity.system_id, server, numbers

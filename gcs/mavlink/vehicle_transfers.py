"""What one vehicle holds and is asked for: missions, parameters, position references and plans."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Sequence
from typing import TypeVar

from gcs.core.errors import GcsError, IncompleteError, LinkError, NotFoundError, OperationCancelled, RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.mission import Command, Mission, MissionItem
from gcs.core.progress import Progress
from gcs.core.replanning import ReplanReport
from gcs.core.vehicle import Autopilot, Failsafe, VehicleIdentity, VehicleLimits
from gcs.mavlink.autopilots.generic import UNKNOWN_STACK
from gcs.mavlink.canonical_form import MissionComparison
from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.external_position import (
    ExternalPosition,
    external_position_lag,
    external_position_message,
    external_position_parameters,
)
from gcs.mavlink.message_rates import request_call
from gcs.mavlink.mission_clear import MissionClear
from gcs.mavlink.mission_ftp import path_of, read_as_file, reading_is_faster, upload_as_file, writing_is_faster
from gcs.mavlink.mission_proof import (
    MissionPeer,
    UploadProof,
    compare_with_vehicle,
    download,
    upload_and_prove,
    upload_list_and_prove,
)
from gcs.mavlink.mission_protocol import ListUnsupportedError, MissionType, check_places
from gcs.mavlink.parameter_pack import PATH as PARAMETER_PACK
from gcs.mavlink.parameter_pack import PackedParameter, decode_parameter_pack
from gcs.mavlink.parameter_protocol import ParameterRead, ParameterReading, ParameterSet
from gcs.mavlink.plan_announcement import PlanAnnouncement
from gcs.mavlink.plan_id import px4_plan_id
from gcs.mavlink.report_assembler import ReportStatus
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_files import VehicleFiles

log = logging.getLogger(__name__)
R = TypeVar("R")

ASK_EVERY_S = 0.7
PACK_FROM = 16
"""So many parameters are read as one file, where there is one: names that it lacks are known at once, while asking for
them by name ends in silence."""
PACK_SLOW_S = 4.0
"""A link on which that file took longer is asked for names from then on."""
CLEARINGS = 3
LIST_CAPABILITY = {
    MissionType.FENCE: mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE,
    MissionType.RALLY: mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY,
}


class VehicleTransfers(VehicleFiles):
    """The half of a `Vehicle` that moves data and commands nothing to move."""

    def __init__(self, identity: VehicleIdentity, channel: VehicleChannel, *, lost_after_s: float) -> None:
        super().__init__(identity, channel, lost_after_s=lost_after_s)
        self._absent_files: set[str] = set()
        self._mission_lock = asyncio.Lock()
        self._absent_lists: set[MissionType] = set()
        self._parameter_lock = asyncio.Lock()
        self._pack_is_slow = False

    async def upload_mission(self, mission: Mission, progress: Progress | None = None) -> UploadProof:
        """Put a mission on it and prove it by reading it back."""
        async with self._mission_lock, self._putting(MissionType.MISSION, mission.items):
            proof = await self._upload_as_file(mission.items, MissionType.MISSION, progress)
            if proof is not None:
                return proof
            return await self._named(upload_and_prove(mission, self._mission_peer(), progress))

    async def download_mission(self, progress: Progress | None = None) -> tuple[MissionItem, ...]:
        """Read the mission that it holds."""
        async with self._mission_lock, self._reading(MissionType.MISSION):
            told = self.telemetry.mission
            if told is not None and told.value.total is not None and reading_is_faster(told.value.total):
                path = path_of(MissionType.MISSION)
                items = await self._by_file(path, lambda: read_as_file(self, MissionType.MISSION))
                if items is not None:
                    return items
            return await self._named(download(self._mission_peer(), progress))

    async def compare_with_vehicle(self, mission: Mission, progress: Progress | None = None) -> MissionComparison:
        """Read the mission that it holds and compare, in its canonical form."""
        async with self._mission_lock, self._reading(MissionType.MISSION):
            return await self._named(compare_with_vehicle(mission, self._mission_peer(), progress))

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
        async with self._mission_lock, self._remembering(mission_type), self._putting(mission_type, items):
            proof = await self._upload_as_file(items, mission_type, progress)
            if proof is not None:
                return proof
            return await self._named(upload_list_and_prove(items, mission_type, self._mission_peer(), progress))

    async def download_list(
        self, mission_type: MissionType, progress: Progress | None = None
    ) -> tuple[MissionItem, ...]:
        """Read its fence or its rally points; errors as those of `upload_list`."""
        self._demand_list(mission_type)
        async with self._mission_lock, self._remembering(mission_type), self._reading(mission_type):
            return await self._named(download(self._mission_peer(), progress, mission_type))

    async def clear_list(self, mission_type: MissionType) -> None:
        """Empty one of its lists, and read that nothing is left: what acknowledged it may be late, and of an upload.

        Raises:
            IncompleteError: it says that it has cleared it, and still holds some of it.
            GcsError: as those of `upload_list`.
        """
        self._demand_list(mission_type)
        home_items = int(mission_type is MissionType.MISSION and self.identity.autopilot is Autopilot.ARDUPILOT)
        async with self._mission_lock, self._remembering(mission_type), self._putting(mission_type, ()):
            for _ in range(CLEARINGS):
                clear = MissionClear(
                    *self._channel.target,
                    self._channel.send,
                    self._now,
                    mission_type,
                    own_system=self._channel.sender[0],
                )
                await self._named(self._channel.run(clear))
                left = len(await self._named(download(self._mission_peer(), mission_type=mission_type)))
                if left <= home_items:
                    return
            raise IncompleteError(f"it still holds {left} items of its {mission_type.noun}", field=self.identity.name)

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
    async def _putting(self, mission_type: MissionType, items: Sequence[MissionItem]) -> AsyncIterator[None]:
        """It holds these items if this succeeds, and who knows what if not; impossible ones are not sent.

        Raises:
            InputError: see `check_places`.
        """
        check_places(items, mission_type)
        self._lists.forget(mission_type)
        yield
        list_id = px4_plan_id(items) if self.identity.autopilot is Autopilot.PX4 else None
        self._lists.uploaded(mission_type, list_id, self._now())

    @contextlib.asynccontextmanager
    async def _reading(self, mission_type: MissionType) -> AsyncIterator[None]:
        """What it holds is known if this succeeds."""
        yield
        self._lists.read(mission_type, self._now())

    @contextlib.asynccontextmanager
    async def _remembering(self, mission_type: MissionType) -> AsyncIterator[None]:
        try:
            yield
        except ListUnsupportedError:
            self._absent_lists.add(mission_type)
            raise

    async def _upload_as_file(
        self, items: Sequence[MissionItem], mission_type: MissionType, progress: Progress | None
    ) -> UploadProof | None:
        """Upload a list as a file where that is served and faster; None when the mission protocol is to do it."""
        home_first = mission_type is not MissionType.MISSION or (items and items[0].command == Command.NAV_WAYPOINT)
        if not home_first or not writing_is_faster(len(items)):
            return None
        target, autopilot = self._channel.target, self.identity.autopilot
        return await self._by_file(
            path_of(mission_type),
            lambda: upload_as_file(items, mission_type, self, target, autopilot, self._now, progress),
        )

    async def _by_file(self, path: str, work: Callable[[], Awaitable[R]]) -> R | None:
        """Do it by a file of its autopilot; None when it serves none, or when that did not work."""
        if not self._stack.serves_lists_as_files or path in self._absent_files:
            return None
        try:
            return await work()
        except OperationCancelled:
            raise
        except NotFoundError:
            self._absent_files.add(path)
        except GcsError as error:
            log.info("%s: not by %s, but one by one: %s", self.identity.name, path, error)
        return None

    async def read_all_parameters(self) -> dict[str, PackedParameter]:
        """Read all its parameters as one file, with their defaults.

        Raises:
            NotFoundError: it serves no such file.
            IncompleteError: the file is damaged.
            LinkError: it does not answer.
        """
        if not self._stack.serves_lists_as_files:
            raise NotFoundError("it serves no file of its parameters", field=self.identity.name)
        return decode_parameter_pack(await self.read_made_up(f"{PARAMETER_PACK}?withdefaults=1"))

    async def read_parameters(self, names: Iterable[str]) -> dict[str, float | None]:
        """Read parameters by name, many as one file where there is one; None where it did not tell one."""
        names = tuple(names)
        packed = None
        if len(names) >= PACK_FROM and not self._pack_is_slow:
            begin = self._now()
            packed = await self._by_file(PARAMETER_PACK, self.read_all_parameters)
            self._pack_is_slow = self._now() - begin > PACK_SLOW_S
        if packed is not None:
            return {name: packed[name].reading.value if name in packed else None for name in names}
        readings = await self._read(names)
        return {name: None if reading is None else reading.value for name, reading in readings.items()}

    async def set_parameter(self, name: str, value: float) -> float:
        """Set a parameter; returns the value that it tells afterwards.

        Raises:
            RefusedError: it has no such parameter, or keeps another value.
            InputError: the value does not fit the parameter's type.
        """
        self._demand_known()
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
        self._demand_known()
        setting = self._stack.return_altitude_setting(altitude_m)
        if setting is None:
            raise RefusedError("its return altitude cannot be set", field=self.identity.name)
        return f"{setting[0]} = {await self.set_parameter(*setting):g}"

    def _demand_known(self) -> None:
        """Nothing is commanded to a vehicle whose flight stack is not known."""
        if not self._stack.known:
            raise RefusedError(UNKNOWN_STACK, field=self.identity.name)

    @property
    def failsafe_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that set its failsafes."""
        return self._stack.failsafe_parameters

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

    async def read_position_lag(self) -> float:
        """How old it takes a position from outside to be when it comes (s).

        Raises:
            RefusedError: its parameters do not let it use one; says what to set.
            LinkError: it does not answer.
        """

        async def read() -> float:
            names = external_position_parameters(self.identity.autopilot)
            return external_position_lag(self.identity.autopilot, await self.read_parameters(names))

        return await self._named(read())

    def shares_link_with(self, other: VehicleTransfers) -> bool:
        """Whether both are spoken to at one address, as on one radio: what names no vehicle goes to both."""
        peer = self._channel.peer()
        return peer is not None and peer is other._channel.peer()

    def tell_position(self, fix: ExternalPosition) -> None:
        """Tell it where it is, once."""
        self._channel.send(external_position_message(self.identity.autopilot, fix))

    async def announce_plan(self, plan_hash: str) -> bool:
        """Tell it the SHA-256 of the plan that it is to fly; False when it does not know of plans."""
        announcement = PlanAnnouncement(plan_hash, self.identity.system_id, self._channel.send, self._now)
        return await self._channel.run(announcement)

    def acknowledge_replan(self, report: ReplanReport, *, stored: bool = True) -> None:
        """Answer a ReplanEvent, once its report is in the store (or refused for good)."""
        self._answer_report(report.boot_id, report.number, ReportStatus.STORED if stored else ReportStatus.REFUSED)

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

"""Passing messages from link to link as autopilots do: to where their target was heard, or everywhere else.

The rules are those of ArduPilot's and PX4's routers: a message goes on to links on which its target system (and
component, if it names one) has been heard, one without a target to all on which its sender has not been heard; never
back to where it came from. What is no message of the dialect does not get here: links drop it.
"""

from __future__ import annotations

from collections.abc import Iterable

from sitl_mocks.channel import Channel
from sitl_mocks.dialect import Message

NOT_PASSED_ON = frozenset({"RADIO", "RADIO_STATUS", "SETUP_SIGNING"})
"""What concerns one link alone."""


class Router:
    """Knows who is on which link of a vehicle.

    Args:
        system_id: of the vehicle.
        components: of the vehicle, that get what is meant for them from nobody's link.
    """

    def __init__(self, system_id: int, components: Iterable[int]) -> None:
        self._own = {(system_id, component) for component in components}
        self._system_id = system_id
        self._heard: dict[Channel, set[tuple[int, int]]] = {}

    def is_own(self, message: Message) -> bool:
        """Whether a message is one of the vehicle's, come back to it."""
        return (message.get_srcSystem(), message.get_srcComponent()) in self._own

    def is_for_vehicle(self, message: Message) -> bool:
        """Whether the vehicle itself, or all, are meant."""
        system, component = _target(message)
        return system == 0 or (system == self._system_id and (component == 0 or (system, component) in self._own))

    def pass_on(self, message: Message, source: Channel, channels: Iterable[Channel]) -> None:
        """Send a message to the links where it belongs, as it came."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self._heard.setdefault(source, set()).add(sender)
        system, component = _target(message)
        if message.get_type() in NOT_PASSED_ON or (system, component) in self._own:
            return
        for channel in channels:
            if channel is not source and self._leads_to(channel, sender, system, component):
                channel.pass_on(bytes(message.get_msgbuf()))

    def forget(self, channel: Channel) -> None:
        """A link is gone."""
        self._heard.pop(channel, None)

    def _leads_to(self, channel: Channel, sender: tuple[int, int], system: int, component: int) -> bool:
        heard = self._heard.get(channel, set())
        if system == 0:
            return sender not in heard
        return (system, component) in heard or (component == 0 and any(s == system for s, _ in heard))


def _target(message: Message) -> tuple[int, int]:
    return getattr(message, "target_system", 0), getattr(message, "target_component", 0)

"""The sample gantry crane, built from its dimensions.

It is a quay-side crane: a four-legged gantry on rails with a luffing double-link boom. Its linkage is
the classic one: the nose beam turns on the boom's tip, held at its rear end by the large pull rods from the top of
the A-frame, and the balance beam on the A-frame carries the counterweight and is joined to the boom by the small pull
rods. The joints follow from the lengths and the boom's angle (circle intersections in the plane of the boom).
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.inspection import NamedPoint
from gcs.core.structure_source import Cable
from gcs.storage.solid_shapes import beam, box, hexahedron, structure_of_solids, tube

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gcs.core.structure import Structure

Vector = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def _circle_intersection(a: Vector, radius_a: float, b: Vector, radius_b: float) -> Vector:
    """The point at `radius_a` from `a` and `radius_b` from `b` that lies left of the way from `a` to `b`."""
    distance = float(np.linalg.norm(b - a))
    along = (radius_a**2 - radius_b**2 + distance**2) / (2 * distance)
    across = np.sqrt(radius_a**2 - along**2)
    u = (b - a) / distance
    result: Vector = a + along * u + across * np.array([-u[1], u[0]])
    return result


def _at(xz: Vector, y: float) -> Vector:
    return np.array([xz[0], y, xz[1]])


class _Linkage:
    """The joints in the plane of the boom, as (x, z)."""

    def __init__(self, d: Mapping[str, Any]) -> None:
        boom, nose, balance = d["boom"], d["nose_beam"], d["balance_beam"]
        angle = np.radians(boom["angle_deg"])
        self.boom_direction = np.array([np.cos(angle), np.sin(angle)])
        self.hinge = np.array(boom["hinge"], dtype=np.float64)
        self.tip = self.hinge + boom["length"] * self.boom_direction
        self.apex = np.array([d["frame_tower"]["apex_x"], d["frame_tower"]["apex_height"]])
        self.nose_joint = _circle_intersection(self.apex, d["large_pull_rod"]["length"], self.tip, nose["rear_arm"])
        nose_direction = (self.tip - self.nose_joint) / nose["rear_arm"]
        self.nose_rear = self.nose_joint - nose["overhang"] * nose_direction
        self.nose_front = self.tip + nose["front_arm"] * nose_direction
        self.nose_direction = nose_direction
        self.pivot = np.array(balance["pivot"], dtype=np.float64)
        self.boom_joint = self.hinge + d["small_pull_rod"]["boom_distance"] * self.boom_direction
        self.balance_front = _circle_intersection(
            self.pivot, balance["front_arm"], self.boom_joint, d["small_pull_rod"]["length"]
        )
        self.balance_direction = (self.balance_front - self.pivot) / balance["front_arm"]
        middle = self.pivot - balance["rear_arm"] * self.balance_direction
        half = d["counterweight"]["hanger_spacing"] / 2 * self.balance_direction
        self.counterweight_front, self.counterweight_rear = middle + half, middle - half


def _gantry(d: Mapping[str, Any]) -> list[Vector]:
    g, c, p = d["gantry"], d["column"], d["platform"]
    x, y, leg, top = g["gauge"] / 2, g["base"] / 2, g["leg_width"], g["portal_height"]
    parts = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            parts.append(
                box(
                    [sx * x - leg / 2, sy * y - g["bogie_length"] / 2, 0.0],
                    [sx * x + leg / 2, sy * y + g["bogie_length"] / 2, g["bogie_height"]],
                )
            )
            parts.append(beam([sx * x, sy * y, g["sill_height"]], [sx * x, sy * y, top], leg, leg))
            parts.append(beam([sx * x, sy * y, top], [0.0, 0.0, top], leg, g["beam_height"]))
        ends = np.array([[sx * x, -y, 0.0], [sx * x, y, 0.0]])
        for height in (g["sill_height"], top):
            parts.append(beam(ends[0] + [0, 0, height], ends[1] + [0, 0, height], leg, g["beam_height"] * 0.8))
        parts.append(beam([-x, sx * y, top], [x, sx * y, top], leg, g["beam_height"] * 0.8))
    parts.append(tube([0, 0, top], [0, 0, c["top"]], c["radius"], 16))
    deck = p["height"] + p["thickness"] / 2
    low = [p["middle_x"] - p["length"] / 2, -p["width"] / 2, p["height"] - p["thickness"] / 2]
    parts.append(box(low, [p["middle_x"] + p["length"] / 2, p["width"] / 2, deck]))
    for room, y_middle in ((d["machinery_house"], 0.0), (d["cab"], d["cab"].get("middle_y", 0.0))):
        half_x, half_y = room["length"] / 2, room["width"] / 2
        parts.append(
            box(
                [room["middle_x"] - half_x, y_middle - half_y, deck],
                [room["middle_x"] + half_x, y_middle + half_y, deck + room["height"]],
            )
        )
    return parts


def _frame_tower(d: Mapping[str, Any], joints: _Linkage) -> list[Vector]:
    f = d["frame_tower"]
    deck = d["platform"]["height"] + d["platform"]["thickness"] / 2
    radius = f["tube_radius"]
    parts = []
    for side in (-1, 1):
        apex = _at(joints.apex, side * f["half_apex_width"])
        feet = [np.array([f[k], side * f["half_foot_width"], deck]) for k in ("front_foot_x", "rear_foot_x")]
        parts += [tube(foot, apex, radius) for foot in feet]
        front, rear = ((foot + apex) / 2 for foot in feet)
        parts.append(tube(front, rear, radius * 0.6))
        parts.append(tube(apex, _at(joints.pivot, side * f["half_apex_width"]), radius * 0.8))
    for foot_x in (f["front_foot_x"], f["rear_foot_x"]):
        for share in (0.35, 0.7):
            x = foot_x + share * (f["apex_x"] - foot_x)
            z = deck + share * (f["apex_height"] - deck)
            y = f["half_foot_width"] + share * (f["half_apex_width"] - f["half_foot_width"])
            parts.append(tube([x, -y, z], [x, y, z], radius * 0.6))
    return parts


def _boom(d: Mapping[str, Any], joints: _Linkage) -> list[Vector]:
    """A lattice of four chords about the axis from hinge to tip."""
    b = d["boom"]
    across = np.array([-joints.boom_direction[1], joints.boom_direction[0]])
    rings = []
    for share in np.linspace(0.0, 1.0, b["bays"] + 1):
        depth = np.interp(share, [0.0, 0.35, 1.0], [b["depth_root"], b["depth_middle"], b["depth_tip"]])
        width = np.interp(share, [0.0, 1.0], [b["half_width_root"], b["half_width_tip"]])
        middle = joints.hinge + share * b["length"] * joints.boom_direction
        rings.append([_at(middle + s * depth / 2 * across, y * width) for s, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))])
    parts = []
    for bay, (ring, after) in enumerate(pairwise(rings)):
        for k in range(4):
            m = (k + 1) % 4
            parts.append(tube(ring[k], after[k], b["chord_radius"]))
            diagonal = (ring[k], after[m]) if bay % 2 else (ring[m], after[k])
            parts.append(tube(*diagonal, b["brace_radius"], 6))
            parts.append(tube(after[k], after[m], b["brace_radius"], 6))
    parts.append(tube(_at(joints.hinge, -b["half_width_root"]), _at(joints.hinge, b["half_width_root"]), 0.3))
    bracket = joints.hinge - [0.0, joints.hinge[1] - d["platform"]["height"]]
    for side in (-1, 1):
        y = side * b["half_width_root"]
        parts.append(beam(_at(bracket, y), _at(joints.hinge, y), 0.5, 0.8))
    return parts


def _nose_beam(d: Mapping[str, Any], joints: _Linkage) -> list[Vector]:
    n = d["nose_beam"]
    across = np.array([-joints.nose_direction[1], joints.nose_direction[0]])

    def section(xz: Vector, depth: float) -> list[Vector]:
        low, high = xz - depth / 2 * across, xz + depth / 2 * across
        half = n["half_width"]
        return [_at(low, -half), _at(low, half), _at(high, half), _at(high, -half)]

    rear = section(joints.nose_rear, n["depth_end"])
    middle = section(joints.tip, n["depth_middle"])
    front = section(joints.nose_front, n["depth_end"])
    return [hexahedron(rear + middle), hexahedron(middle + front)]


def _balance_beam(d: Mapping[str, Any], joints: _Linkage) -> list[Vector]:
    b, c = d["balance_beam"], d["counterweight"]
    rear_end = joints.counterweight_rear - 0.4 * joints.balance_direction
    top = min(joints.counterweight_front[1], joints.counterweight_rear[1]) - c["hanger_length"]
    middle = (joints.counterweight_front[0] + joints.counterweight_rear[0]) / 2
    parts = [
        box(
            [middle - c["length"] / 2, -c["width"] / 2, top - c["height"]],
            [middle + c["length"] / 2, c["width"] / 2, top],
        )
    ]
    for side in (-1, 1):
        y = side * b["half_width"]
        parts.append(beam(_at(rear_end, y), _at(joints.balance_front, y), b["beam_width"], b["beam_height"]))
        for joint in (joints.counterweight_front, joints.counterweight_rear):
            parts.append(beam([joint[0], y, top], _at(joint, y), 0.25, 0.4))
    for xz in (joints.counterweight_rear, joints.balance_front):
        parts.append(tube(_at(xz, -b["half_width"]), _at(xz, b["half_width"]), 0.15))
    return parts


def gantry_crane(dimensions: Mapping[str, Any]) -> Structure:
    """Build the sample gantry crane with its boom raised and no load.

    Args:
        dimensions: the numbers of the sample's data file (m, deg).

    Returns:
        About 6,000 triangles; four pull rods as cables; points L1-L9 (left, y > 0) and R1-R9, each on the outer
        surface of its joint with the normal to its own side.
    """
    d = dimensions
    joints = _Linkage(d)
    overhang, pin_radius = d["pin"]["overhang"], d["pin"]["radius"]
    frame, balance, nose = d["frame_tower"], d["balance_beam"], d["nose_beam"]
    large, small = d["large_pull_rod"], d["small_pull_rod"]
    frame_side = frame["half_apex_width"] + frame["tube_radius"] + overhang
    balance_side = balance["half_width"] + balance["beam_width"] / 2 + overhang
    small_side = small["half_spacing"] + small["radius"]
    pins = {
        "balance_pivot": (joints.pivot, frame_side),
        "counterweight_front": (joints.counterweight_front, balance_side),
        "counterweight_rear": (joints.counterweight_rear, balance_side),
        "large_rod_lower": (joints.apex, frame_side),
        "large_rod_upper": (joints.nose_joint, large["half_spacing"] + large["radius"] + overhang),
        "boom_end": (joints.tip, d["boom"]["half_width_tip"] + d["boom"]["chord_radius"] + overhang),
        "small_rod_front": (joints.boom_joint, small_side + overhang),
        "small_rod_rear": (joints.balance_front, small_side + overhang),
    }
    parts = _gantry(d) + _frame_tower(d, joints) + _boom(d, joints) + _nose_beam(d, joints) + _balance_beam(d, joints)
    parts += [tube(_at(xz, -half), _at(xz, half), pin_radius, 12) for xz, half in pins.values()]
    inset = nose["depth_end"] / 2 * joints.nose_direction
    places = pins | {
        "small_rod_middle": ((joints.boom_joint + joints.balance_front) / 2, small_side),
        "nose_rear": (joints.nose_rear + inset, nose["half_width"]),
        "nose_front": (joints.nose_front - inset, nose["half_width"]),
    }
    cables, points = [], []
    for letter, side in (("L", 1), ("R", -1)):
        for a, b, rod in (
            (joints.apex, joints.nose_joint, large),
            (joints.boom_joint, joints.balance_front, small),
        ):
            ends = [tuple(float(v) for v in _at(xz, side * rod["half_spacing"])) for xz in (a, b)]
            cables.append(Cable.model_validate({"from_m": ends[0], "to_m": ends[1], "radius_m": rod["radius"]}))
        for point in d["points"]:
            xz, half = places[point["at"]]
            position = tuple(float(v) for v in _at(xz, side * half))
            name = f"{letter}{point['number']}"
            points.append(
                NamedPoint.model_validate({"name": name, "position_m": position, "normal": (0.0, float(side), 0.0)})
            )
    notes = ("sample gantry crane with our own typical dimensions; the paper that names its points gives none",)
    return structure_of_solids(parts, tuple(cables), tuple(points), notes)

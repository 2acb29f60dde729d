"""Tables of the station's database."""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, ForeignKey, Index, MetaData, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column


class Base(DeclarativeBase):
    """Base of all tables; constraints have fixed names, so that migrations can find them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {dict[str, Any]: JSON, list[Any]: JSON}  # noqa: RUF012 - SQLAlchemy's own form


class StructureRow(Base):
    """A mesh that was brought in."""

    __tablename__ = "structures"

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    created_at: Mapped[str]
    file_name: Mapped[str]
    original_name: Mapped[str]
    sha256: Mapped[str]
    scale: Mapped[float]
    up: Mapped[str]
    position_m: Mapped[list[Any]]
    rotation_deg: Mapped[float]
    triangles: Mapped[int]
    low_m: Mapped[list[Any]]
    high_m: Mapped[list[Any]]
    notes: Mapped[list[Any]]


class PlanRow(Base):
    """A plan that was asked for."""

    __tablename__ = "plans"

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    created_at: Mapped[str]
    scenario: Mapped[dict[str, Any]]
    state: Mapped[str]
    plan_hash: Mapped[str | None]
    report: Mapped[dict[str, Any] | None]
    failure: Mapped[dict[str, Any] | None]


class JobRow(Base):
    """A background job of a plan."""

    __tablename__ = "jobs"

    id: Mapped[str] = mapped_column(primary_key=True)
    plan_id: Mapped[str] = mapped_column(ForeignKey("plans.id", ondelete="CASCADE"), index=True)
    state: Mapped[str]
    stage: Mapped[str]
    fraction: Mapped[float]
    created_at: Mapped[str]
    finished_at: Mapped[str | None]


class LinkRow(Base):
    """A link that the operator opened."""

    __tablename__ = "links"

    id: Mapped[str] = mapped_column(primary_key=True)
    url: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[str]


class FlightRow(Base):
    """A flight."""

    __tablename__ = "flights"

    id: Mapped[str] = mapped_column(primary_key=True)
    plan_id: Mapped[str] = mapped_column(ForeignKey("plans.id", ondelete="RESTRICT"), index=True)
    plan_hash: Mapped[str]
    vehicle: Mapped[str]
    system_id: Mapped[int]
    mode: Mapped[str]
    state: Mapped[str] = mapped_column(index=True)
    created_at: Mapped[str]
    updated_at: Mapped[str]
    viewpoints: Mapped[int]
    proved: Mapped[bool]
    started_at: Mapped[str | None]
    ended_at: Mapped[str | None]
    accepted_failsafes: Mapped[list[Any]]
    plan_time_s: Mapped[float | None]
    max_cross_track_m: Mapped[float | None]
    problems: Mapped[list[Any]]
    mission_sampling: Mapped[dict[str, Any] | None]
    observer: Mapped[str | None]


class FlightEventRow(Base):
    """A line of a flight's log; never changed."""

    __tablename__ = "flight_events"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"), index=True)
    at: Mapped[str]
    kind: Mapped[str]
    severity: Mapped[int]
    text: Mapped[str]
    data: Mapped[dict[str, Any]]

    __table_args__ = ({"sqlite_autoincrement": True},)


class TrackPointRow(Base):
    """A point of a flown path."""

    __tablename__ = "track_points"

    id: Mapped[int] = mapped_column(primary_key=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"))
    at_s: Mapped[float]
    x_m: Mapped[float]
    y_m: Mapped[float]
    z_m: Mapped[float]
    cross_track_m: Mapped[float | None]

    __table_args__ = (Index(None, "flight_id", "at_s"),)


class VisitRow(Base):
    """A viewpoint that was reached."""

    __tablename__ = "visits"

    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"), primary_key=True)
    viewpoint_id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    at: Mapped[str]
    miss_m: Mapped[float | None]


class UploadRow(Base):
    """An attempt to put a mission on a vehicle."""

    __tablename__ = "uploads"

    id: Mapped[int] = mapped_column(primary_key=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"), index=True)
    state: Mapped[str]
    started_at: Mapped[str]
    finished_at: Mapped[str | None]
    items_sent: Mapped[int]
    items_read: Mapped[int]
    how: Mapped[str]
    canonical_crc32: Mapped[int | None]
    items: Mapped[list[Any]]
    problem: Mapped[str | None]


class ImageRow(Base):
    """A picture of a flight."""

    __tablename__ = "images"

    id: Mapped[str] = mapped_column(primary_key=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"))
    index: Mapped[int | None]
    viewpoint_id: Mapped[int | None]
    viewpoint_name: Mapped[str | None]
    state: Mapped[str]
    source: Mapped[str]
    announced_at: Mapped[str]
    vehicle_path: Mapped[str | None]
    vehicle_time_s: Mapped[float | None]
    position_m: Mapped[list[Any] | None]
    file_name: Mapped[str | None]
    size_bytes: Mapped[int | None]
    crc32: Mapped[int | None]
    stored_at: Mapped[str | None]
    problem: Mapped[str | None]

    __table_args__ = (UniqueConstraint("flight_id", "source", "index"),)


class LearnedDynamicsRow(Base):
    """What flights have shown of a vehicle."""

    __tablename__ = "learned_dynamics"

    vehicle: Mapped[str] = mapped_column(primary_key=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"))
    learned_at: Mapped[str]
    drag_s: Mapped[float | None]
    drag_sigma_s: Mapped[float | None]
    lag_s: Mapped[float | None]
    lag_sigma_s: Mapped[float | None]
    tilt_lag_s: Mapped[float | None]
    tilt_lag_sigma_s: Mapped[float | None]


class ReplanRow(Base):
    """A reported detour; stored once."""

    __tablename__ = "replan_reports"

    id: Mapped[int] = mapped_column(primary_key=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"))
    system_id: Mapped[int]
    boot_id: Mapped[int]
    number: Mapped[int]
    received_at: Mapped[str]
    plan_hash: Mapped[str]
    reason: Mapped[str]
    mission_item: Mapped[int]
    left_at_s: Mapped[float]
    rejoined_at_s: Mapped[float | None]
    path_m: Mapped[list[Any]]
    plan_hash_after: Mapped[str | None]
    obstacle: Mapped[dict[str, Any] | None]
    viewpoints: Mapped[list[Any]]

    __table_args__ = (UniqueConstraint("flight_id", "system_id", "boot_id", "number"),)


class PlanOfferRow(Base):
    """A plan that was offered for what a flight skipped."""

    __tablename__ = "plan_offers"

    id: Mapped[str] = mapped_column(primary_key=True)
    flight_id: Mapped[str] = mapped_column(ForeignKey("flights.id", ondelete="RESTRICT"), index=True)
    state: Mapped[str]
    created_at: Mapped[str]
    viewpoints: Mapped[list[Any]]
    names: Mapped[list[Any]]
    length_m: Mapped[float | None]
    duration_s: Mapped[float | None]
    decided_at: Mapped[str | None]
    plan_id: Mapped[str | None] = mapped_column(ForeignKey("plans.id", ondelete="SET NULL"))
    failure: Mapped[dict[str, Any] | None]

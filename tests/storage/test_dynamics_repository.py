"""What flights show of their vehicles lasts, by vehicle."""

from pathlib import Path

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import create_engine, text

import gcs.storage
from gcs.core.errors import StorageError
from gcs.core.learned_dynamics import NOTHING_LEARNED, Estimate, LearnedDynamics
from gcs.storage.database import Database

ALL = LearnedDynamics(Estimate(0.9, 0.05), Estimate(-0.02, 0.03), Estimate(0.21, 0.02))


def test_a_vehicle_that_never_flew_has_shown_nothing(database):
    assert database.dynamics.of("px4-1") == NOTHING_LEARNED


def test_the_last_flight_counts_and_each_vehicle_has_its_own(database, flight):
    database.dynamics.keep("px4-1", flight.id, ALL)
    database.dynamics.keep("ardupilot-2", flight.id, LearnedDynamics(lag=Estimate(0.0, 0.05)))
    assert database.dynamics.of("px4-1") == ALL
    assert database.dynamics.of("ardupilot-2") == LearnedDynamics(lag=Estimate(0.0, 0.05))
    database.dynamics.keep("px4-1", flight.id, LearnedDynamics(drag=Estimate(0.0, 0.1)))
    assert database.dynamics.of("px4-1") == LearnedDynamics(drag=Estimate(0.0, 0.1))


def test_it_is_there_after_a_restart(database, flight, tmp_path):
    database.dynamics.keep("px4-1", flight.id, ALL)
    again = Database(tmp_path)
    assert again.dynamics.of("px4-1") == ALL
    again.close()


def test_what_no_flight_has_shown_is_not_taken(database):
    with pytest.raises(StorageError):
        database.dynamics.keep("px4-1", "no such flight", ALL)


def test_a_database_of_an_earlier_release_keeps_its_flights(tmp_path):
    engine = create_engine(f"sqlite:///{tmp_path / 'gcs.sqlite3'}")
    config = Config()
    config.set_main_option("script_location", str(Path(gcs.storage.__file__).parent / "migrations"))
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
        connection.execute(
            text("INSERT INTO plans (id, name, created_at, scenario, state) VALUES ('p', 'p', 'then', '{}', 'ready')")
        )
        connection.execute(
            text(
                "INSERT INTO flights (id, plan_id, plan_hash, vehicle, system_id, mode, state, created_at, updated_at, "
                "viewpoints, proved, accepted_failsafes, problems) VALUES ('f', 'p', '', 'px4-1', 1, 'mission', "
                "'completed', 'then', 'then', 3, 1, '[]', '[]')"
            )
        )
    engine.dispose()
    database = Database(tmp_path)
    flight = database.flights.get("f")
    assert (flight.vehicle, flight.mission_sampling) == ("px4-1", None)
    database.dynamics.keep("px4-1", "f", ALL)
    database.close()

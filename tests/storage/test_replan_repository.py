from dataclasses import replace

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import create_engine, text

from gcs.core.clock import utc_now
from gcs.core.errors import NotFoundError
from gcs.storage.database import FILE_NAME, Database
from gcs.storage.records import (
    Failure,
    OfferState,
    PlanOfferRecord,
    ReplanObstacle,
    ReplanRecord,
    ViewpointFateName,
    ViewpointFateRecord,
)

HASH, AFTER = "ab" * 32, "cd" * 32


@pytest.fixture
def report(flight):
    return ReplanRecord(
        id=0,
        flight_id=flight.id,
        system_id=1,
        boot_id=77,
        number=1,
        received_at=utc_now(),
        plan_hash=HASH,
        reason="a moving obstacle",
        mission_item=-1,
        left_at_s=12.5,
        rejoined_at_s=19.0,
        path_m=((0.0, 0.0, 10.0), (1.0, 0.0, 10.0)),
        plan_hash_after=AFTER,
        obstacle=ReplanObstacle((0.5, 1.0, 10.0), 0.7, (1.0, -0.5)),
        viewpoints=(
            ViewpointFateRecord(3, ViewpointFateName.SKIPPED),
            ViewpointFateRecord(4, ViewpointFateName.MOVED, (1.0, 2.0, 3.0)),
        ),
    )


def test_a_report_comes_back_whole_and_is_stored_once(database, flight, report):
    first, new = database.replans.add(report)
    again, new_again = database.replans.add(replace(report, reason="told otherwise"))
    assert (new, new_again) == (True, False)
    assert first == again == replace(report, id=first.id)
    assert database.replans.of_flight(flight.id) == (first,)


def test_a_report_that_comes_again_during_the_next_flight_is_the_same_one(database, flight, report):
    database.replans.add(report)
    database.flights.add(replace(flight, id="flight-2"))
    stored, new = database.replans.add(replace(report, flight_id="flight-2"))
    assert (new, stored.flight_id) == (False, "flight-1")
    assert database.replans.of_flight("flight-2") == ()


def test_numbers_of_another_boot_or_vehicle_are_others(database, flight, report):
    for other in (report, replace(report, boot_id=78), replace(report, system_id=2), replace(report, number=2)):
        assert database.replans.add(other)[1]
    assert [r.number for r in database.replans.of_boot(1, 77)] == [1, 2]


def test_a_vehicle_that_did_not_come_back_has_no_time_of_it(database, report):
    stored, _ = database.replans.add(replace(report, rejoined_at_s=None, obstacle=None, viewpoints=()))
    assert (stored.rejoined_at_s, stored.obstacle, stored.viewpoints) == (None, None, ())


def test_reports_of_an_older_station_stay_readable(tmp_path):
    engine = create_engine(f"sqlite:///{tmp_path / FILE_NAME}")
    config = Config()
    config.set_main_option("script_location", "gcs:storage/migrations")
    rows = (
        "INSERT INTO plans (id, name, created_at, scenario, state, plan_hash)"
        " VALUES ('p', 'p', 't', '{}', 'ready', 'h')",
        "INSERT INTO flights (id, plan_id, plan_hash, vehicle, system_id, mode, state, created_at, updated_at,"
        " viewpoints, proved, accepted_failsafes, problems) VALUES"
        " ('f', 'p', 'h', 'px4-1', 1, 'mission', 'completed', 't', 't', 3, 1, '[]', '[]')",
        "INSERT INTO replan_reports (flight_id, system_id, boot_id, number, received_at, plan_hash, reason,"
        " mission_item, left_at_s, rejoined_at_s, path_m, matches_plan) VALUES"
        " ('f', 1, 7, 1, 't', 'h', 'a bird', 3, 10.0, 14.5, '[[1, 2, 3], [4, 5, 6]]', 1)",
    )
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0002")
        for row in rows:
            connection.execute(text(row))
    engine.dispose()
    database = Database(tmp_path)
    (old,) = database.replans.of_flight("f")
    assert (old.reason, old.path_m, old.rejoined_at_s) == ("a bird", ((1, 2, 3), (4, 5, 6)), 14.5)
    assert (old.plan_hash_after, old.obstacle, old.viewpoints) == (None, None, ())
    database.close()


def test_an_offer_is_kept_with_what_became_of_it(database, flight):
    offer = PlanOfferRecord("offer-1", flight.id, OfferState.PLANNING, utc_now(), (2, 5), ("A", "B"))
    database.offers.add(offer)
    assert database.offers.in_state(OfferState.PLANNING) == (offer,)
    failure = Failure("No plan", "the way is blocked")
    changed = database.offers.update(offer.id, state=OfferState.FAILED, failure=vars(failure))
    assert changed == replace(offer, state=OfferState.FAILED, failure=failure) == database.offers.get(offer.id)
    assert database.offers.of_flight(flight.id) == (changed,)
    with pytest.raises(NotFoundError):
        database.offers.get("offer-2")

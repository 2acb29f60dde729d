import pytest

from gcs.core.clock import utc_now
from gcs.storage.database import Database
from gcs.storage.records import FlightPath, FlightRecord, FlightState, JobRecord, JobState, PlanRecord, PlanState


@pytest.fixture
def database(tmp_path):
    database = Database(tmp_path)
    yield database
    database.close()


@pytest.fixture
def make_plan_record():
    def make(plan_id="plan-1", state=PlanState.READY):
        return PlanRecord(plan_id, "box", utc_now(), {"name": "box"}, state, plan_hash="ab" * 32)

    return make


@pytest.fixture
def make_job_record():
    def make(job_id="job-1", plan_id="plan-1", state=JobState.RUNNING):
        return JobRecord(job_id, plan_id, state, "tour", 0.5, utc_now())

    return make


@pytest.fixture
def flight(database, make_plan_record):
    database.plans.add(make_plan_record())
    now = utc_now()
    record = FlightRecord(
        id="flight-1",
        plan_id="plan-1",
        plan_hash="ab" * 32,
        vehicle="px4-1",
        system_id=1,
        mode=FlightPath.MISSION,
        state=FlightState.CREATED,
        created_at=now,
        updated_at=now,
        viewpoints=3,
    )
    database.flights.add(record)
    return record

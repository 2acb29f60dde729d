import os
import subprocess
import sys
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import create_engine, inspect, text

from gcs.core.errors import ConflictError, NotFoundError, StorageError
from gcs.storage.data_directory import owned_data_directory
from gcs.storage.database import Database, migrate
from gcs.storage.records import JobState, PlanState
from gcs.storage.tables import Base


def test_migrations_lead_from_nothing_to_the_tables_of_the_models(tmp_path):
    engine = create_engine(f"sqlite:///{tmp_path / 'new.sqlite3'}")
    migrate(engine)
    with engine.connect() as connection:
        difference = compare_metadata(MigrationContext.configure(connection), Base.metadata)
    assert difference == []
    assert {"structures", "plans", "jobs", "links", "flights", "flight_events"} <= set(
        inspect(engine).get_table_names()
    )
    engine.dispose()


def test_opening_again_changes_nothing(tmp_path, make_plan_record):
    first = Database(tmp_path)
    first.plans.add(make_plan_record())
    first.close()
    second = Database(tmp_path)
    assert second.plans.get("plan-1").plan_hash == "ab" * 32
    second.close()


def test_sqlite_keeps_a_write_ahead_log_and_checks_foreign_keys(database, make_job_record):
    with database.transaction() as session:
        assert session.scalar(text("PRAGMA journal_mode")) == "wal"
        assert session.scalar(text("PRAGMA foreign_keys")) == 1
    with pytest.raises(StorageError):
        database.jobs.add(make_job_record(plan_id="no such plan"))


def test_an_error_inside_a_transaction_undoes_it(database, make_plan_record):
    def both():
        with database.transaction() as session:
            session.execute(text("INSERT INTO links (id, url, created_at) VALUES ('l', 'u', 'now')"))
            raise ValueError

    with pytest.raises(ValueError):
        both()
    assert database.links.all() == ()


def test_a_full_disk_is_one_clear_sentence(tmp_path, make_plan_record):
    database = Database(tmp_path)
    with database.transaction() as session:
        pages = session.scalar(text("PRAGMA page_count"))
    limited = Database(tmp_path)
    from sqlalchemy import event

    event.listen(limited._engine, "connect", lambda c, _: c.execute(f"PRAGMA max_page_count={pages}"))
    limited._engine.dispose()
    big = make_plan_record()
    big.scenario["text"] = "x" * 1_000_000
    with pytest.raises(StorageError, match="disk is full"):
        limited.plans.add(big)
    assert database.plans.all() == ()
    limited.close()
    database.close()


def test_a_database_that_is_none_is_named(tmp_path):
    (tmp_path / "gcs.sqlite3").write_bytes(b"this is not a database, but long enough to be looked at" * 30)
    with pytest.raises(StorageError, match="not a database"):
        Database(tmp_path)


def test_a_killed_process_loses_no_committed_record_and_its_jobs_are_marked_interrupted(tmp_path):
    script = """
import os, signal, sys
from pathlib import Path
from gcs.core.clock import utc_now
from gcs.storage.database import Database
from gcs.storage.records import *
d = Database(Path(sys.argv[1]))
d.plans.add(PlanRecord("plan-1", "box", utc_now(), {}, PlanState.PLANNING))
d.plans.add(PlanRecord("plan-2", "box", utc_now(), {}, PlanState.READY))
d.jobs.add(JobRecord("job-1", "plan-1", JobState.RUNNING, "tour", 0.4, utc_now()))
d.jobs.add(JobRecord("job-2", "plan-2", JobState.DONE, "done", 1.0, utc_now()))
with d.transaction() as session:
    session.execute(__import__("sqlalchemy").text("DELETE FROM plans"))
    os.kill(os.getpid(), signal.SIGKILL)
"""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        check=False,
    )
    assert done.returncode == -9
    database = Database(tmp_path)
    assert len(database.plans.all()) == 2
    assert database.jobs.mark_interrupted() == 1
    job = database.jobs.latest_of_plan("plan-1")
    assert job is not None
    assert (job.state, job.stage, job.fraction) == (JobState.INTERRUPTED, "tour", 0.4)
    assert job.finished_at is not None
    plan = database.plans.get("plan-1")
    assert plan.state is PlanState.INTERRUPTED
    assert plan.failure is not None
    assert "plan it again" in plan.failure.message
    assert database.plans.get("plan-2").state is PlanState.READY
    database.close()


def test_one_station_at_a_time_owns_a_data_directory(tmp_path):
    with owned_data_directory(tmp_path / "data"):
        with pytest.raises(ConflictError, match="another station"), owned_data_directory(tmp_path / "data"):
            pass
        assert (tmp_path / "data").stat().st_mode & 0o077 == 0
    with owned_data_directory(tmp_path / "data"):
        pass


def test_a_plan_with_flights_is_kept(database, flight):
    with pytest.raises(ConflictError, match="flights"):
        database.plans.delete(flight.plan_id)
    assert database.plans.get(flight.plan_id).id == flight.plan_id


def test_deleting_a_plan_takes_its_jobs_along(database, make_plan_record, make_job_record):
    database.plans.add(make_plan_record())
    database.jobs.add(make_job_record(state=JobState.DONE))
    database.plans.delete("plan-1")
    assert database.jobs.latest_of_plan("plan-1") is None
    with pytest.raises(NotFoundError):
        database.plans.get("plan-1")


def test_a_link_is_kept_once(database):
    assert database.links.add("udpin:127.0.0.1:14550") == database.links.add("udpin:127.0.0.1:14550")
    assert len(database.links.all()) == 1
    database.links.delete(database.links.all()[0].id)
    assert database.links.all() == ()

"""From a scenario to a folder with a certified plan: at once for the command line, as a job for the station."""

from __future__ import annotations

import asyncio
import logging
import shutil
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import ConflictError, GcsError, InputError, NotFoundError, OperationCancelled
from gcs.core.plan import Plan
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Scenario, parse_scenario
from gcs.services.live_feed import JobChanged, LiveFeed, PlanChanged, PlanDeleted
from gcs.storage.atomic_files import new_directory, open_folder
from gcs.storage.records import Failure, JobRecord, JobState, PlanRecord, PlanState

if TYPE_CHECKING:
    from gcs.core.frames import GeoPoint
    from gcs.core.progress import Progress
    from gcs.core.structure import Structure
    from gcs.jobs.planning_jobs import PlanningJobs
    from gcs.planning.fleet import Fleet
    from gcs.planning.flights.plan_group import SortieSeries
    from gcs.services.plan_group_writing import WrittenGroup
    from gcs.services.plan_writing import WrittenPlan
    from gcs.storage.database import Database

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PlanView:
    """A plan of the station with its latest job and the files that are there."""

    plan: PlanRecord
    job: JobRecord | None
    files: tuple[str, ...] = ()


def write_planned(scenario: Scenario, base: Path, out: Path, progress: Progress) -> WrittenPlan | WrittenGroup:
    """Plan and write all files.

    Args:
        scenario: what is asked.
        base: folder that mesh files are relative to.
        out: folder to make; one that holds earlier plans is replaced.
        progress: told of every stage; may cancel.

    Returns:
        One plan; or several, for several vehicles, or when some sorties start from rally points.

    Raises:
        InputError: the scenario or a mesh cannot be used, or `out` is not ours to replace.
        InfeasibleError: there is no plan.
        StorageError: the disk did not take it; nothing half-written stays.
        OperationCancelled: the progress said so.
    """
    scenario, structure = _resolved(scenario, base, out, progress)
    planned = _planned(scenario, structure, progress)
    if isinstance(planned, Plan):
        from gcs.services.plan_writing import write_certified

        return write_certified(planned, structure, out, progress)
    from gcs.services.plan_group_writing import write_plan_group

    return write_plan_group(scenario, planned, structure, out, progress)


def _planned(scenario: Scenario, structure: Structure, progress: Progress) -> Plan | Fleet | SortieSeries:
    if scenario.vehicle.count > 1:
        from gcs.planning.fleet import plan_fleet

        return plan_fleet(scenario, structure, progress)
    from gcs.planning.planner import make_plan

    return make_plan(scenario, structure, progress)


def _resolved(scenario: Scenario, base: Path, out: Path, progress: Progress) -> tuple[Scenario, Structure]:
    """The scenario with all that its structure says, and the structure."""
    from gcs.storage.mesh_files import load_structure, sample_inspection
    from gcs.storage.plan_files import check_output

    check_output(out)
    progress.report("load", 0.0)
    structure, source = load_structure(scenario.structure, base)
    inspection = scenario.inspection or sample_inspection(source.sample, structure)
    safety = scenario.safety.model_copy(
        update={"model_m": scenario.safety.model_m + structure.placement_error_m}
    )  # so that whoever reads the plan has the whole budget
    progress.report("load", 1.0)
    update = {"structure": source, "inspection": inspection, "safety": safety}
    return scenario.model_copy(update=update), structure


def plan_to_directory(scenario_path: Path, out: Path, progress: Progress | None = None) -> WrittenPlan | WrittenGroup:
    """`gcs plan`: from a scenario file to a folder with a plan, or several; raises as `write_planned`."""
    from gcs.storage.scenario_files import read_scenario_file

    scenario = read_scenario_file(scenario_path)
    return write_planned(scenario, scenario_path.parent, out, progress or SilentProgress())


def plan_job(progress: Progress, scenario: dict[str, Any], base: str, out: str) -> None:
    """What a worker process does for one plan."""
    write_planned(parse_scenario(scenario), Path(base), Path(out), progress)


class PlanService:
    """Plans of the station.

    Args:
        database: where they are listed.
        feed: the dashboards.
        data_dir: the data directory; plans are in its folder `plans`.
        jobs: runs the planning.
    """

    def __init__(self, database: Database, feed: LiveFeed, data_dir: Path, jobs: PlanningJobs) -> None:
        self._database = database
        self._feed = feed
        self._folder = data_dir / "plans"
        self._structures = data_dir / "structures"
        self._jobs = jobs
        self._running: dict[str, asyncio.Task[None]] = {}
        self._progress: dict[str, tuple[str, float]] = {}
        self._read = lru_cache(maxsize=4)(self._read_files)

    def open(self) -> None:
        """Make the folder, and remove what a killed station left half-written.

        Raises:
            StorageError: it cannot be made.
        """
        open_folder(self._folder)

    async def close(self) -> None:
        """End all jobs; those that were running are marked interrupted."""
        for task in self._running.values():
            task.cancel()
        await asyncio.gather(*self._running.values(), return_exceptions=True)
        await self._jobs.close()
        self._database.jobs.mark_interrupted()

    def list(self) -> list[PlanView]:
        """Newest first."""
        jobs = self._database.jobs.latest()
        return [self._view(plan, jobs.get(plan.id)) for plan in self._database.plans.all()]

    def get(self, plan_id: str) -> PlanView:
        """One plan.

        Raises:
            NotFoundError: there is none of this name.
        """
        return self._view(self._database.plans.get(plan_id), self._database.jobs.latest_of_plan(plan_id))

    def directory(self, plan_id: str) -> Path:
        """The folder of a ready plan.

        Raises:
            NotFoundError: there is none of this name.
            ConflictError: it is not ready.
        """
        plan = self._database.plans.get(plan_id)
        if plan.state is not PlanState.READY:
            raise ConflictError(f"this plan is not ready but {plan.state}", field="plan_id")
        return self._folder / plan.id

    def read(self, plan_id: str) -> Plan:
        """A ready plan in full.

        Raises:
            NotFoundError: there is none of this name.
            ConflictError: it is not ready.
            InputError: its files were damaged.
        """
        return self._read(str(self.directory(plan_id)))

    def anchor(self, plan_id: str) -> GeoPoint:
        """Where the scene of a plan is."""
        return parse_scenario(self._database.plans.get(plan_id).scenario).anchor.point

    def file_by_hash(self, plan_hash: str, name: str) -> Path:
        """One of the files of the plan whose plan.json has a SHA-256; errors as of `file`."""
        return self.file(self._database.plans.with_hash(plan_hash).id, name)

    def file(self, plan_id: str, name: str) -> Path:
        """One of the files of a ready plan.

        Raises:
            NotFoundError: it is not one of the known names, or not there.
        """
        from gcs.storage.plan_files import FILE_NAMES

        path = self.directory(plan_id) / name
        if name not in FILE_NAMES or not path.is_file():
            raise NotFoundError(f"this plan has no file {name}", field="name")
        return path

    async def submit(self, scenario: dict[str, Any]) -> PlanView:
        """Check a scenario and begin to plan.

        Raises:
            InputError: naming the field.
        """
        parsed = parse_scenario(scenario)
        if parsed.vehicle.count > 1:
            raise InputError(
                "the station plans for one vehicle: use 1, or `gcs plan` for several", field="vehicle.count"
            )
        self._check_files(parsed)
        plan = PlanRecord(
            id=new_id("plan"),
            name=parsed.name,
            created_at=utc_now(),
            scenario=parsed.model_dump(mode="json", exclude_none=True),
            state=PlanState.PLANNING,
        )
        job = JobRecord(new_id("job"), plan.id, JobState.QUEUED, "queued", 0.0, utc_now())
        self._database.plans.add(plan)
        self._database.jobs.add(job)
        self._running[plan.id] = asyncio.create_task(self._run(plan, job), name=job.id)
        view = self._view(plan, job)
        self._feed.publish(PlanChanged(view))
        return view

    def adopt(self, directory: Path, name: str | None = None) -> PlanView:
        """Take over a plan that was written elsewhere, its sorties as plans of their own.

        One with the same hash is not taken twice.

        Args:
            directory: its folder.
            name: in the list of plans; the scenario's when left out.

        Raises:
            InputError: the folder holds no plan, or not a whole one.
            StorageError: the disk did not take it.
        """
        from gcs.storage.plan_files import part_directories, plan_hash, read_plan, read_report, read_structure

        plan, own_hash = read_plan(directory), plan_hash(directory)
        for known in self._database.plans.all():
            if known.plan_hash == own_hash and known.state is PlanState.READY:
                return self.get(known.id)
        report = read_report(directory)
        read_structure(directory)
        record = PlanRecord(
            id=new_id("plan"),
            name=name or plan.scenario.name,
            created_at=utc_now(),
            scenario=plan.scenario.model_dump(mode="json", exclude_none=True),
            state=PlanState.READY,
            plan_hash=own_hash,
            report=report,
        )
        self._take_files(directory, record.id)
        self._database.plans.add(record)
        for part in part_directories(directory):
            self.adopt(part)
        view = self.get(record.id)
        self._feed.publish(PlanChanged(view))
        return view

    async def wait(self, plan_id: str) -> PlanView:
        """Wait until a plan is made, or will not be.

        Raises:
            NotFoundError: there is none of this name.
        """
        task = self._running.get(plan_id)
        if task is not None:
            await asyncio.wait({task})
        return self.get(plan_id)

    async def cancel(self, plan_id: str) -> PlanView:
        """Stop planning, and wait until it has stopped.

        Raises:
            NotFoundError: there is none of this name.
            ConflictError: it is not being planned.
        """
        view = self.get(plan_id)
        task = self._running.get(plan_id)
        if task is None or view.job is None:
            raise ConflictError(f"this plan is not being made, it is {view.plan.state}", field="plan_id")
        await self._jobs.cancel(view.job.id)
        await asyncio.wait({task})
        return self.get(plan_id)

    def delete(self, plan_id: str) -> None:
        """Remove a plan that no flight has used.

        Raises:
            NotFoundError: there is none of this name.
            ConflictError: it is being made, or flights of it are on record.
        """
        plan = self._database.plans.get(plan_id)
        if plan.state is PlanState.PLANNING:
            raise ConflictError("this plan is being made: cancel it first", field="plan_id")
        self._database.plans.delete(plan_id)
        shutil.rmtree(self._folder / plan.id, ignore_errors=True)
        self._feed.publish(PlanDeleted(plan_id))

    async def _run(self, plan: PlanRecord, job: JobRecord) -> None:
        def on_progress(stage: str, fraction: float) -> None:
            changed_stage = self._progress.get(job.id, ("", 0.0))[0] != stage
            self._progress[job.id] = (stage, fraction)
            if changed_stage:
                self._database.jobs.update(job.id, JobState.RUNNING, stage, fraction)
            self._feed.publish(JobChanged(replace(job, state=JobState.RUNNING, stage=stage, fraction=fraction)))

        try:
            folder = self._folder / plan.id
            await self._jobs.run(job.id, plan_job, plan.scenario, str(self._structures), str(folder), tell=on_progress)
            self._end(job, JobState.DONE)
            self._take_over(plan.id)
        except OperationCancelled as error:
            self._end(job, JobState.CANCELLED)
            self._database.plans.mark_ended(plan.id, PlanState.CANCELLED, Failure(error.title, error.message))
        except GcsError as error:
            self._end(job, JobState.FAILED)
            self._database.plans.mark_ended(plan.id, PlanState.FAILED, Failure(error.title, error.message, error.field))
        except Exception as error:
            log.exception("planning %s failed", plan.id)
            self._end(job, JobState.FAILED)
            failure = Failure(
                "Internal fault", f"planning failed unexpectedly ({error!r}); the station's log says more"
            )
            self._database.plans.mark_ended(plan.id, PlanState.FAILED, failure)
        finally:
            self._running.pop(plan.id, None)
            self._progress.pop(job.id, None)
            self._feed.publish(PlanChanged(self.get(plan.id)))

    def _take_over(self, plan_id: str) -> None:
        """List what a job wrote. Of sorties that have no plan in common the first takes the plan's place."""
        from gcs.storage.plan_files import is_group_directory, part_directories, plan_hash, read_plan, read_report

        folder = self._folder / plan_id
        parts = part_directories(folder)
        in_common = not is_group_directory(folder)
        for part in parts if in_common else parts[1:]:
            self.adopt(part)
        if not in_common:
            self._take_files(parts[0], plan_id)
            scenario = read_plan(folder).scenario
            self._database.plans.narrow(plan_id, scenario.name, scenario.model_dump(mode="json", exclude_none=True))
        self._database.plans.mark_ready(plan_id, plan_hash(folder), read_report(folder))

    def _take_files(self, directory: Path, plan_id: str) -> None:
        """Put a copy of a plan's files, without those of its parts, where the station keeps them."""
        from gcs.storage.plan_files import FILE_NAMES, is_ours

        with new_directory(self._folder / plan_id, is_ours) as folder:
            for name in FILE_NAMES:
                if (directory / name).is_file():
                    shutil.copyfile(directory / name, folder / name)

    def _end(self, job: JobRecord, state: JobState) -> None:
        stage, fraction = self._progress.get(job.id, ("", 0.0))
        if state is JobState.DONE:
            stage, fraction = "done", 1.0
        self._feed.publish(JobChanged(self._database.jobs.update(job.id, state, stage, fraction)))

    def _check_files(self, scenario: Scenario) -> None:
        """Meshes of the station are inside its own folder, whatever a scenario names."""
        for k, mesh in enumerate(scenario.structure.meshes):
            inside = PurePosixPath(mesh.file)
            path = self._structures / inside
            if inside.is_absolute() or ".." in inside.parts or not path.is_file():
                raise InputError(
                    "this station has no such mesh: bring it in first and take the `source` of the structure",
                    field=f"structure.meshes.{k}.file",
                )

    def _view(self, plan: PlanRecord, job: JobRecord | None) -> PlanView:
        from gcs.storage.plan_files import FILE_NAMES

        if job is not None and job.id in self._progress:
            stage, fraction = self._progress[job.id]
            job = replace(job, stage=stage, fraction=fraction)
        folder = self._folder / plan.id
        ready = plan.state is PlanState.READY
        return PlanView(plan, job, tuple(n for n in FILE_NAMES if (folder / n).is_file()) if ready else ())

    @staticmethod
    def _read_files(directory: str) -> Plan:
        from gcs.storage.plan_files import read_plan

        return read_plan(Path(directory))

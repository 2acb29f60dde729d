import { describe, get } from '../api/client';
import { parsePly } from '../formats/ply';
import type { PlanDetail } from '../api/types';
import type { TriangleMesh } from '../scene/structure_layer';
import { chooseFlight, choosePlan, chooseVehicle } from './selection';
import type { Station } from './station.svelte';
import { NO_RECORDS } from './station_state';

/** A plan with everything needed to draw it. */
export interface LoadedPlan {
  detail: PlanDetail;
  mesh: TriangleMesh;
}

/** What the operator looks at: one vehicle, one plan and the flight that joins them. */
export class Workspace {
  chosenVehicle: string | null = $state(null);
  chosenPlan: string | null = $state(null);
  selectedViewpoint: number | null = $state(null);
  loaded: LoadedPlan | null = $state.raw(null);
  loadProblem: string | null = $state(null);

  readonly vehicle = $derived.by(() => chooseVehicle(this.station.state.vehicles, this.chosenVehicle));
  readonly plan = $derived.by(() =>
    choosePlan(
      this.station.state.plans,
      this.station.state.flights,
      this.vehicle?.info.name ?? null,
      this.chosenPlan,
    ),
  );
  readonly flight = $derived.by(() =>
    chooseFlight(this.station.state.flights, this.vehicle?.info.name ?? null, this.plan?.id ?? null),
  );
  /** Records of the flight. */
  readonly records = $derived.by(() => (this.flight && this.station.state.records[this.flight.id]) || NO_RECORDS);
  /** Whether the flight flies the plan that is looked at. */
  readonly flightIsOfPlan = $derived.by(() => this.flight !== null && this.flight.plan_id === this.plan?.id);

  private wanted: string | null = null;

  constructor(private readonly station: Station) {}

  /** Load a plan for drawing; what was drawn before goes at once, so that no two plans are mixed up. */
  async load(planId: string | null): Promise<void> {
    this.wanted = planId;
    this.loadProblem = null;
    if (this.loaded?.detail.id !== planId) this.loaded = null;
    this.selectedViewpoint = null;
    if (planId === null || this.loaded) return;
    try {
      const [detail, ply] = await Promise.all([
        get<PlanDetail>(`/plans/${planId}/detail`),
        fetch(`/api/plans/${planId}/files/structure.ply`),
      ]);
      if (!ply.ok) throw new Error(`the structure file is not there (${ply.status})`);
      const mesh = parsePly(await ply.arrayBuffer());
      if (this.wanted === planId) this.loaded = { detail, mesh };
    } catch (error) {
      if (this.wanted === planId) this.loadProblem = `The plan cannot be drawn: ${describe(error)}`;
    }
  }
}

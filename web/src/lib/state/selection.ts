import type { FlightInfo, PlanSummary } from '../api/types';
import type { KnownVehicle } from './station_state';

type FlightState = FlightInfo['state'];

/** States in which a flight owns its vehicle, whatever plan is looked at. */
const ACTIVE: ReadonlySet<FlightState> = new Set<FlightState>([
  'uploading',
  'armed',
  'flying',
  'paused',
  'held',
  'returning',
  'landing',
  'unknown',
]);
const OVER: ReadonlySet<FlightState> = new Set<FlightState>(['completed', 'incomplete', 'aborted']);

export function isActive(flight: FlightInfo): boolean {
  return ACTIVE.has(flight.state);
}

export function isOver(flight: FlightInfo): boolean {
  return OVER.has(flight.state);
}

/** The chosen vehicle while it is known, else the first that is heard, else the first. */
export function chooseVehicle(vehicles: readonly KnownVehicle[], chosen: string | null): KnownVehicle | null {
  return (
    vehicles.find((v) => v.info.name === chosen) ?? vehicles.find((v) => v.info.connected) ?? vehicles[0] ?? null
  );
}

/** The plan to look at: the chosen one, else that of the vehicle's active flight, else the newest that is ready. */
export function choosePlan(
  plans: readonly PlanSummary[],
  flights: readonly FlightInfo[],
  vehicle: string | null,
  chosen: string | null,
): PlanSummary | null {
  const active = flights.find((f) => f.vehicle === vehicle && isActive(f));
  return (
    plans.find((p) => p.id === chosen) ??
    plans.find((p) => p.id === active?.plan_id) ??
    plans.find((p) => p.state === 'ready') ??
    plans[0] ??
    null
  );
}

/**
 * The flight the operator acts on: one that owns the vehicle now, else the newest of this plan by this vehicle.
 *
 * @param flights newest first.
 */
export function chooseFlight(
  flights: readonly FlightInfo[],
  vehicle: string | null,
  planId: string | null,
): FlightInfo | null {
  const own = flights.filter((f) => f.vehicle === vehicle);
  return own.find(isActive) ?? own.find((f) => f.plan_id === planId) ?? null;
}

import type {
  FlightEvent,
  FlightInfo,
  ImageInfo,
  LeaseInfo,
  LinkInfo,
  LiveMessage,
  OnVehicle,
  PlanOfferInfo,
  PlanSummary,
  ReplanInfo,
  Snapshot,
  TrackSample,
  VehicleInfo,
  VehicleMessage,
} from '../api/types';
import { ascending, descending, union, upsert } from './merge';

const LOG_LIMIT = 500;

/** A vehicle as last told of, and when that arrived here (ms of the page's monotonic clock). */
export interface KnownVehicle {
  info: VehicleInfo;
  receivedMs: number;
}

/** A companion's lease as last told of, likewise. */
export interface KnownLease {
  info: LeaseInfo;
  receivedMs: number;
}

export interface LogLine {
  key: string;
  at: string;
  /** 0 emergency to 7 debug. */
  severity: number;
  /** Who says it: a vehicle's name, `flight` or `station`. */
  source: string;
  text: string;
}

export interface UploadProgress {
  phase: string;
  fraction: number;
}

/** What belongs to one flight beyond its summary. */
export interface FlightRecords {
  track: readonly TrackSample[];
  images: readonly ImageInfo[];
  replans: readonly ReplanInfo[];
  /** Plans that were offered for what was skipped, newest first. */
  offers: readonly PlanOfferInfo[];
  /** Null until it was asked for. */
  onVehicle: OnVehicle | null;
}

/** Everything the station has told, as plain values; changed only by `applyLive` and the REST fill-ups beside it. */
export interface StationState {
  links: readonly LinkInfo[];
  vehicles: readonly KnownVehicle[];
  plans: readonly PlanSummary[];
  flights: readonly FlightInfo[];
  /** By flight. */
  leases: Readonly<Record<string, KnownLease>>;
  uploads: Readonly<Record<string, UploadProgress>>;
  records: Readonly<Record<string, FlightRecords>>;
  log: readonly LogLine[];
}

export const NOTHING_KNOWN: StationState = {
  links: [],
  vehicles: [],
  plans: [],
  flights: [],
  leases: {},
  uploads: {},
  records: {},
  log: [],
};

export const NO_RECORDS: FlightRecords = { track: [], images: [], replans: [], offers: [], onVehicle: null };

/**
 * The state after a message of the live stream.
 *
 * @param nowMs when the message arrived, ms of the page's monotonic clock.
 */
export function applyLive(state: StationState, message: LiveMessage, nowMs: number): StationState {
  switch (message.type) {
    case 'snapshot':
      return applySnapshot(state, message, nowMs);
    case 'telemetry':
      return { ...state, vehicles: withVehicle(state.vehicles, message.vehicle, nowMs) };
    case 'link':
      return { ...state, links: withLink(state.links, message.link) };
    case 'message':
      return withLog(state, [vehicleLine(message.message)]);
    case 'job':
      return { ...state, plans: state.plans.map((p) => (p.id === message.job.plan_id ? { ...p, job: message.job } : p)) };
    case 'plan':
      return { ...state, plans: withPlan(state.plans, message.plan) };
    case 'plan_deleted':
      return { ...state, plans: state.plans.filter((p) => p.id !== message.plan_id) };
    case 'flight':
      return applyFlight(state, message.flight);
    case 'upload':
      return { ...state, uploads: { ...state.uploads, [message.flight_id]: message } };
    case 'track':
      return withRecords(state, message.flight_id, { track: message.points });
    case 'event':
      return withLog(state, [eventLine(message.event)]);
    case 'image':
      return withRecords(state, message.image.flight_id, { images: [message.image] });
    case 'replan':
      return withRecords(state, message.replan.flight_id, { replans: [message.replan] });
    case 'lease':
      return { ...state, leases: { ...state.leases, ...byFlight([message.lease], nowMs) } };
    case 'offer':
      return withRecords(state, message.offer.flight_id, { offers: [message.offer] });
    case 'heartbeat':
      return state;
  }
}

/** Add what belongs to a flight; what is there already stays, in order and once. */
export function withRecords(state: StationState, flightId: string, more: Partial<FlightRecords>): StationState {
  const old = state.records[flightId] ?? NO_RECORDS;
  const records: FlightRecords = {
    track: more.track ? union(old.track, more.track, (p) => p.at_s, ascending((p) => p.at_s)) : old.track,
    images: more.images
      ? union(old.images, more.images, (i) => i.id, ascending((i) => i.announced_at))
      : old.images,
    replans: more.replans ? union(old.replans, more.replans, (r) => r.id, descending((r) => r.id)) : old.replans,
    offers: more.offers ? union(old.offers, more.offers, (o) => o.id, descending((o) => `${o.created_at} ${o.id}`)) : old.offers,
    onVehicle: more.onVehicle ?? old.onVehicle,
  };
  return { ...state, records: { ...state.records, [flightId]: records } };
}

/** Add lines to the log, newest first, none twice. */
export function withLog(state: StationState, lines: readonly LogLine[]): StationState {
  const log = union(state.log, lines, (l) => l.key, descending((l) => `${l.at} ${l.key}`));
  return { ...state, log: log.slice(0, LOG_LIMIT) };
}

export function withPlan(plans: readonly PlanSummary[], plan: PlanSummary): PlanSummary[] {
  return upsert(plans, plan, (p) => p.id).sort(descending((p) => p.created_at));
}

export function withFlight(flights: readonly FlightInfo[], flight: FlightInfo): FlightInfo[] {
  return upsert(flights, flight, (f) => f.id).sort(descending((f) => f.created_at));
}

export function withLink(links: readonly LinkInfo[], link: LinkInfo): LinkInfo[] {
  return link.state === 'closed' ? links.filter((l) => l.id !== link.id) : upsert(links, link, (l) => l.id);
}

export function eventLine(event: FlightEvent): LogLine {
  const { id, at, severity, text } = event;
  return { key: `event ${id}`, at, severity, source: 'flight', text };
}

export function vehicleLine(message: VehicleMessage): LogLine {
  const { number, at, severity, vehicle, text } = message;
  // Numbers start again when the station does, times do not.
  return { key: `vehicle ${String(number).padStart(9, '0')} ${at}`, at, severity, source: vehicle, text };
}

function applySnapshot(state: StationState, snapshot: Snapshot, nowMs: number): StationState {
  return withLog(
    {
      ...state,
      links: snapshot.links,
      vehicles: snapshot.vehicles.map((info) => ({ info, receivedMs: nowMs })),
      plans: [...snapshot.plans].sort(descending((p) => p.created_at)),
      flights: [...snapshot.flights].sort(descending((f) => f.created_at)),
      leases: byFlight(snapshot.leases, nowMs),
      uploads: {},
    },
    snapshot.messages.map(vehicleLine),
  );
}

function byFlight(leases: readonly LeaseInfo[], receivedMs: number): Record<string, KnownLease> {
  return Object.fromEntries(leases.map((info) => [info.flight_id, { info, receivedMs }]));
}

function applyFlight(state: StationState, flight: FlightInfo): StationState {
  const uploads = { ...state.uploads };
  if (flight.state !== 'uploading') delete uploads[flight.id];
  return { ...state, uploads, flights: withFlight(state.flights, flight) };
}

function withVehicle(vehicles: readonly KnownVehicle[], info: VehicleInfo, nowMs: number): KnownVehicle[] {
  return upsert(vehicles, { info, receivedMs: nowMs }, (v) => v.info.name).sort(ascending((v) => v.info.system_id));
}

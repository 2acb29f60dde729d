/** What a station may tell, for tests. */
import type { FlightInfo, ImageInfo, LeaseInfo, PlanOfferInfo, PlanSummary, ReplanInfo, Snapshot, TrackSample, VehicleInfo } from '../api/types';

const AT = '2026-11-22T10:00:00Z';

export function vehicle(changes: Partial<VehicleInfo> = {}): VehicleInfo {
  return {
    name: 'px4-1', system_id: 1, autopilot: 'px4', vehicle_type: 2, connected: true, last_heard_age_s: 0,
    link_quality: 1, messages_per_s: 80, round_trip_s: 0.04, flight_id: null, ways: [], armed: null, mode: null, mode_name: null, landed: null,
    position: null, local_position_m: null, velocity_m_s: null, yaw_deg: null, attitude: null, gimbal_pitch_deg: null,
    battery: null, home: null, mission: null, gps_fix: null, satellites: null, ready_to_arm: null, ...changes,
  };
}

export function plan(changes: Partial<PlanSummary> = {}): PlanSummary {
  return {
    id: 'p1', name: 'plan', created_at: AT, state: 'ready', plan_hash: null, report: null, failure: null, job: null,
    files: [], ...changes,
  };
}

export function flight(changes: Partial<FlightInfo> = {}): FlightInfo {
  return {
    id: 'f1', plan_id: 'p1', plan_hash: '', vehicle: 'px4-1', system_id: 1, mode: 'mission', state: 'created',
    created_at: AT, updated_at: AT, started_at: null, ended_at: null, proved: false, viewpoints: 3,
    viewpoints_reached: 0, images_expected: 3, images_received: 0, max_cross_track_m: null, plan_time_s: null,
    accepted_failsafes: [], observer: null, problems: [], actions: [], ...changes,
  };
}

export function image(changes: Partial<ImageInfo> = {}): ImageInfo {
  return {
    id: 'i1', flight_id: 'f1', index: 0, viewpoint_id: 0, viewpoint_name: 'V', state: 'announced', source: 'link',
    announced_at: AT, stored_at: null, vehicle_path: null, position_m: null, size_bytes: null, crc32: null,
    problem: null, ...changes,
  };
}

export function replan(changes: Partial<ReplanInfo> = {}): ReplanInfo {
  return {
    id: 1, flight_id: 'f1', boot_id: 1, number: 1, received_at: AT, reason: '', mission_item: 0, left_at_s: 0,
    rejoined_at_s: 1, plan_hash: '', plan_hash_after: null, chain: 'known', left_out: null, path_m: [], flown_length_m: 0,
    flown_duration_s: 1, obstacle: null, viewpoints: [], ...changes,
  };
}

export function offer(changes: Partial<PlanOfferInfo> = {}): PlanOfferInfo {
  return {
    id: 'o1', flight_id: 'f1', state: 'planning', created_at: AT, viewpoints: [1], names: ['V'], length_m: null,
    duration_s: null, decided_at: null, plan_id: null, failure: null, ...changes,
  };
}

export function lease(changes: Partial<LeaseInfo> = {}): LeaseInfo {
  return {
    flight_id: 'f1', lease: '00c0ffee', state: 'leading', text: 'leads', away: null, plan_time_s: 0, reports_pending: 0,
    lidar_age_s: 0.1, odometry_quality: 90, age_s: 0, ...changes,
  };
}

export function trackPoint(atS: number): TrackSample {
  return { at_s: atS, position_m: [0, 0, atS], cross_track_m: null };
}

export function snapshot(changes: Partial<Snapshot> = {}): Snapshot {
  return {
    type: 'snapshot', at: AT, reason: 'start', links: [], vehicles: [], plans: [], flights: [], leases: [], messages: [],
    ...changes,
  };
}

/** Short names for the schemas of the station's OpenAPI document. */
import type { components } from '../api-types';

type Schemas = components['schemas'];

export type LiveMessage = Schemas['LiveMessage'];
export type Snapshot = Schemas['SnapshotMessage'];
export type VehicleInfo = Schemas['VehicleInfo'];
export type VehicleMessage = Schemas['VehicleMessage'];
export type StructureDetail = Schemas['StructureDetail'];
export type LinkInfo = Schemas['LinkInfo'];
export type SigningInfo = Schemas['SigningInfo'];
export type WayInfo = Schemas['WayInfo'];
export type PlanSummary = Schemas['PlanSummary'];
export type PlanDetail = Schemas['PlanDetail'];
export type PlanReport = Schemas['PlanReport'];
export type PlanAccepted = Schemas['PlanAccepted'];
export type JobInfo = Schemas['JobInfo'];
export type FlightInfo = Schemas['FlightInfo'];
export type FlightEvent = Schemas['FlightEvent'];
export type PreflightInfo = Schemas['PreflightInfo'];
export type PreflightCheck = Schemas['PreflightCheck'];
export type TrackSample = Schemas['TrackSample'];
export type Track = Schemas['Track'];
export type OnVehicle = Schemas['OnVehicle'];
export type LeaseInfo = Schemas['LeaseInfo'];
export type ImageInfo = Schemas['ImageInfo'];
export type ReplanInfo = Schemas['ReplanInfo'];
export type PlanOfferInfo = Schemas['PlanOfferInfo'];
export type GeoPosition = Schemas['GeoPosition'];
export type Problem = Schemas['Problem'];
export type ViewpointInfo = Schemas['ViewpointInfo'];

/** A value heard from a vehicle and how old it was when the station sent it. */
export interface Reading<T> {
  value: T;
  age_s: number;
  stale: boolean;
}

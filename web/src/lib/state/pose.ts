import type { GeoPosition } from '../api/types';
import { enuFromGeodetic } from '../formats/geodesy';
import type { VehiclePose } from '../scene/vehicle_layer';
import { age } from './freshness';
import type { KnownVehicle } from './station_state';

const RAD = Math.PI / 180;

/** Where a vehicle is in a scene and where it looks, as last heard; null when its position is unknown. */
export function scenePose(vehicle: KnownVehicle, anchor: GeoPosition, nowMs: number, live: boolean): VehiclePose | null {
  const waitedS = (nowMs - vehicle.receivedMs) / 1000;
  const position = age(vehicle.info.position, waitedS, live);
  if (position.value === null) return null;
  const yaw = vehicle.info.yaw_deg?.value ?? null;
  const pitch = vehicle.info.gimbal_pitch_deg?.value ?? null;
  return {
    position_m: enuFromGeodetic(position.value, anchor),
    yaw_rad: yaw === null ? null : yaw * RAD,
    gimbal_pitch_rad: pitch === null ? null : pitch * RAD,
    stale: position.stale || !vehicle.info.connected,
  };
}

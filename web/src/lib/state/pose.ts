import type { GeoPosition, VehicleInfo } from '../api/types';
import { enuFromGeodetic } from '../formats/geodesy';
import type { VehiclePose } from '../scene/vehicle_layer';

const RAD = Math.PI / 180;

/** Where a vehicle is in a scene and where it looks, as last heard; null when its position is unknown. */
export function scenePose(vehicle: VehicleInfo, anchor: GeoPosition, stale: boolean): VehiclePose | null {
  if (!vehicle.position) return null;
  const yaw = vehicle.yaw_deg?.value ?? null;
  const pitch = vehicle.gimbal_pitch_deg?.value ?? null;
  return {
    position_m: enuFromGeodetic(vehicle.position.value, anchor),
    yaw_rad: yaw === null ? null : yaw * RAD,
    gimbal_pitch_rad: pitch === null ? null : pitch * RAD,
    stale,
  };
}

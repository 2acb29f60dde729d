import type { GeoPosition } from '../api/types';

const SEMI_MAJOR_M = 6378137;
const FLATTENING = 1 / 298.257223563;
const ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING);

type Vector = [number, number, number];

/** Earth-centred coordinates (m) on WGS84; heights above mean sea level stand in for ellipsoidal ones on both sides. */
function ecef(p: GeoPosition): Vector {
  const lat = (p.latitude_deg * Math.PI) / 180;
  const lon = (p.longitude_deg * Math.PI) / 180;
  const n = SEMI_MAJOR_M / Math.sqrt(1 - ECCENTRICITY_SQUARED * Math.sin(lat) ** 2);
  const across = (n + p.altitude_m) * Math.cos(lat);
  return [across * Math.cos(lon), across * Math.sin(lon), (n * (1 - ECCENTRICITY_SQUARED) + p.altitude_m) * Math.sin(lat)];
}

/** A place in the scene: east, north, up of the anchor (m). */
export function enuFromGeodetic(place: GeoPosition, anchor: GeoPosition): Vector {
  const [x, y, z] = ecef(place);
  const [x0, y0, z0] = ecef(anchor);
  const [dx, dy, dz] = [x - x0, y - y0, z - z0];
  const lat = (anchor.latitude_deg * Math.PI) / 180;
  const lon = (anchor.longitude_deg * Math.PI) / 180;
  const [sinLat, cosLat, sinLon, cosLon] = [Math.sin(lat), Math.cos(lat), Math.sin(lon), Math.cos(lon)];
  return [
    -sinLon * dx + cosLon * dy,
    -sinLat * cosLon * dx - sinLat * sinLon * dy + cosLat * dz,
    cosLat * cosLon * dx + cosLat * sinLon * dy + sinLat * dz,
  ];
}

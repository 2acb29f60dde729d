import { describe, expect, it } from 'vitest';

import { enuFromGeodetic } from './geodesy';

const place = (latitude_deg: number, longitude_deg: number, altitude_m: number) => ({ latitude_deg, longitude_deg, altitude_m });
const ANCHOR = place(31.3622, 121.6155, 4);

describe('scene place of a geodetic one', () => {
  // Computed with pymap3d.
  it.each([
    [31.3631, 121.6149, 57.5, -57.0848, 99.7892, 53.499],
    [31.3622, 121.6155, 4.0, 0.0, 0.0, 0.0],
    [31.3522, 121.6355, -3.0, 1903.0281, -1108.5828, -7.3804],
  ])('agrees with pymap3d at %s, %s, %s', (lat, lon, alt, east, north, up) => {
    const enu = enuFromGeodetic(place(lat, lon, alt), ANCHOR);
    [east, north, up].forEach((value, axis) => expect(enu[axis]).toBeCloseTo(value, 3));
  });
});

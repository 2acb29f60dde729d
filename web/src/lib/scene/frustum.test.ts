import { describe, expect, it } from 'vitest';

import { frustumSegments } from './frustum';

describe('camera pyramid', () => {
  // Looks north from (1, 2, 3), image up is the scene's up: the image's right is east.
  const points = frustumSegments(
    { position_m: [1, 2, 3], direction: [0, 1, 0], up: [0, 0, 1] },
    { halfWidth: 0.75, halfHeight: 0.5 },
    2,
  );
  const at = (i: number) => points.slice(3 * i, 3 * i + 3);

  it('has nine segments', () => {
    expect(points).toHaveLength(9 * 2 * 3);
  });

  it('starts at the eye and spans the field of view at its depth', () => {
    expect(at(0)).toEqual([1, 2, 3]);
    expect(at(1)).toEqual([-0.5, 4, 2]);
    expect(at(5)).toEqual([2.5, 4, 2]);
  });

  it('marks the upper side', () => {
    expect(at(17)[2]).toBeGreaterThan(at(16)[2] ?? 0);
    expect(at(16)).toEqual([1, 4, 4]);
  });
});

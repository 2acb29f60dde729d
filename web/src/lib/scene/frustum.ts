import { Vector3 } from 'three';

import type { Point3 } from './lines';

export interface CameraPose {
  position_m: Point3;
  /** Unit view direction. */
  direction: Point3;
  /** Unit upward direction of the image, square to the view direction. */
  up: Point3;
}

export interface FieldOfView {
  /** Half the image's width and height at unit distance. */
  halfWidth: number;
  halfHeight: number;
}

/** Width over height of common cameras, used until the plan's own camera is known. */
export const COMMON_VIEW: FieldOfView = { halfWidth: 0.75, halfHeight: 0.5 };

/**
 * Line segments of a small camera pyramid: four edges, the far rectangle and a tick that marks its upper side.
 *
 * @returns 18 points as x, y, z: nine segments.
 */
export function frustumSegments(pose: CameraPose, view: FieldOfView, depthM: number): number[] {
  const eye = new Vector3(pose.position_m[0], pose.position_m[1], pose.position_m[2]);
  const forward = new Vector3(pose.direction[0], pose.direction[1], pose.direction[2]);
  const up = new Vector3(pose.up[0], pose.up[1], pose.up[2]);
  const right = forward.clone().cross(up);
  const at = (x: number, y: number) =>
    eye
      .clone()
      .addScaledVector(forward, depthM)
      .addScaledVector(right, x * view.halfWidth * depthM)
      .addScaledVector(up, y * view.halfHeight * depthM);
  const corners = [at(-1, -1), at(1, -1), at(1, 1), at(-1, 1)] as const;
  const points: Vector3[] = [];
  corners.forEach((corner, i) => points.push(eye, corner, corner, corners[(i + 1) % 4] ?? corner));
  points.push(at(0, 1), at(0, 1.35));
  return points.flatMap((p) => p.toArray());
}

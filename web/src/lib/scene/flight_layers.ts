import {
  BufferAttribute,
  BufferGeometry,
  CylinderGeometry,
  Mesh,
  MeshBasicMaterial,
  Points,
  PointsMaterial,
} from 'three';

import { label } from './label';
import { Layer } from './layer';
import { thickLine, type Point3 } from './lines';
import { palette } from './palette';

/** The mission as it was read back from the vehicle: a line with a square marker at every item that has a place. */
export class OnVehicleLayer extends Layer {
  constructor() {
    super('on-vehicle');
  }

  show(positions: readonly Point3[]): void {
    this.clear();
    if (positions.length === 0) return;
    const line = thickLine(positions, palette.onVehicle, 1.5, 0.75);
    if (line) this.group.add(line);
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(new Float32Array(positions.flatMap((p) => [...p])), 3));
    const squares = new PointsMaterial({ color: palette.onVehicle, size: 7, sizeAttenuation: false });
    this.group.add(new Points(geometry, squares));
  }
}

/** Where the vehicle has really been in this flight. */
export class FlownLayer extends Layer {
  constructor() {
    super('flown');
  }

  show(track: readonly Point3[]): void {
    this.clear();
    const line = thickLine(track, palette.flown, 3);
    if (line) this.group.add(line);
  }
}

/** A departure from the plan as it is drawn. */
export interface Detour {
  number: number;
  path_m: readonly Point3[];
  left_out: { path_m: readonly Point3[] } | null;
  obstacle: { position_m: Point3; radius_m: number } | null;
}

/** The vehicle tells a place and a radius of an obstacle, and no height: so much is drawn of it. */
const OBSTACLE_HEIGHT_M = 4;

/** Pieces that the vehicle reported to have flown instead of the planned ones, and what was in the way. */
export class DetourLayer extends Layer {
  constructor() {
    super('detours');
  }

  show(detours: readonly Detour[]): void {
    this.clear();
    for (const detour of detours) {
      const leftOut = thickLine(detour.left_out?.path_m ?? [], palette.leftOut, 5, 0.9);
      if (leftOut) this.group.add(leftOut);
      if (detour.obstacle) this.group.add(cylinder(detour.obstacle));
      const line = thickLine(detour.path_m, palette.detour, 5, 0.9);
      const middle = detour.path_m[Math.floor(detour.path_m.length / 2)];
      if (!line || !middle) continue;
      const name = label(`detour ${detour.number}`, palette.detour);
      name.position.set(middle[0] ?? 0, middle[1] ?? 0, middle[2] ?? 0);
      this.group.add(line, name);
    }
  }
}

function cylinder(obstacle: NonNullable<Detour['obstacle']>): Mesh {
  const geometry = new CylinderGeometry(obstacle.radius_m, obstacle.radius_m, OBSTACLE_HEIGHT_M, 24);
  geometry.rotateX(Math.PI / 2); // upright where z is up
  const material = new MeshBasicMaterial({ color: palette.obstacle, transparent: true, opacity: 0.55 });
  const mesh = new Mesh(geometry, material);
  const [x = 0, y = 0, z = 0] = obstacle.position_m;
  mesh.position.set(x, y, z);
  return mesh;
}

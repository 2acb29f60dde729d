import {
  BufferAttribute,
  BufferGeometry,
  Color,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  RingGeometry,
  Vector3,
} from 'three';

import { COMMON_VIEW, frustumSegments, type CameraPose, type FieldOfView } from './frustum';
import { label } from './label';
import { Layer } from './layer';
import { dashedLine, thickLine, type Point3 } from './lines';
import { palette } from './palette';

/** With more viewpoints than this, names are shown under the pointer only. */
const NAMES_LIMIT = 60;
const FRUSTUM_DEPTH_M = 1.1;
const VERTICES_A_FRUSTUM = 18;

export interface DrawnViewpoint extends CameraPose {
  id: number;
  name: string;
}

/** Places of the pictures as small camera pyramids, coloured by whether their picture is there. */
export class ViewpointLayer extends Layer {
  private viewpoints: readonly DrawnViewpoint[] = [];
  private colors: BufferAttribute | null = null;

  constructor() {
    super('viewpoints');
  }

  show(viewpoints: readonly DrawnViewpoint[], view: FieldOfView = COMMON_VIEW): void {
    this.clear();
    this.viewpoints = viewpoints;
    this.colors = null;
    if (viewpoints.length === 0) return;
    const points = viewpoints.flatMap((v) => frustumSegments(v, view, FRUSTUM_DEPTH_M));
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(new Float32Array(points), 3));
    this.colors = new BufferAttribute(new Float32Array(points.length), 3);
    geometry.setAttribute('color', this.colors);
    this.group.add(new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true })));
    if (viewpoints.length <= NAMES_LIMIT) {
      for (const v of viewpoints) {
        const name = label(v.name, palette.viewpoint);
        name.position.set(v.position_m[0] ?? 0, v.position_m[1] ?? 0, v.position_m[2] ?? 0);
        this.group.add(name);
      }
    }
    this.mark(new Set(), new Set(), null);
  }

  /** Colour the viewpoints whose picture is on disk, those that the vehicle skipped, and the selected one. */
  mark(photographed: ReadonlySet<number>, skipped: ReadonlySet<number>, selected: number | null): void {
    const colors = this.colors;
    if (!colors) return;
    this.viewpoints.forEach((viewpoint, i) => {
      const { id } = viewpoint;
      const color = new Color(
        id === selected
          ? palette.selected
          : photographed.has(id)
            ? palette.photographed
            : skipped.has(id)
              ? palette.skipped
              : palette.viewpoint,
      );
      for (let k = 0; k < VERTICES_A_FRUSTUM; k += 1) {
        colors.setXYZ(i * VERTICES_A_FRUSTUM + k, color.r, color.g, color.b);
      }
    });
    colors.needsUpdate = true;
  }

  /** The viewpoint whose place is nearest to a spot on the canvas, within `limitPx`. */
  nearest(
    project: (p: Vector3) => { x: number; y: number } | null,
    xPx: number,
    yPx: number,
    limitPx = 14,
  ): DrawnViewpoint | null {
    let best: DrawnViewpoint | null = null;
    let bestPx = limitPx;
    for (const viewpoint of this.viewpoints) {
      const [x, y, z] = viewpoint.position_m;
      const spot = project(new Vector3(x, y, z));
      const distance = spot ? Math.hypot(spot.x - xPx, spot.y - yPx) : Infinity;
      if (distance < bestPx) [best, bestPx] = [viewpoint, distance];
    }
    return best;
  }
}

/** The search's polyline of straight legs, as thin dashes. */
export class PathLayer extends Layer {
  constructor() {
    super('path');
  }

  show(path: readonly Point3[]): void {
    this.clear();
    const line = dashedLine(path, palette.path, 0.6);
    if (line) this.group.add(line);
  }
}

/** The planned trajectory. */
export class TrajectoryLayer extends Layer {
  constructor() {
    super('trajectory');
  }

  show(trajectory: readonly Point3[]): void {
    this.clear();
    const line = thickLine(trajectory, palette.trajectory, 2);
    if (line) this.group.add(line);
  }
}

/** Where the plan starts and ends: a ring on the ground. */
export class HomeLayer extends Layer {
  constructor() {
    super('home');
  }

  show(home: Point3 | null): void {
    this.clear();
    if (!home) return;
    const ring = new Mesh(new RingGeometry(0.8, 1.15, 40), new MeshBasicMaterial({ color: palette.home }));
    const name = label('home', palette.home);
    for (const part of [ring, name]) part.position.set(home[0] ?? 0, home[1] ?? 0, (home[2] ?? 0) + 0.03);
    this.group.add(ring, name);
  }
}

import {
  BufferAttribute,
  BufferGeometry,
  CylinderGeometry,
  DoubleSide,
  GridHelper,
  Mesh,
  MeshStandardMaterial,
  Vector3,
} from 'three';

import { Layer } from './layer';
import { palette } from './palette';
import type { Point3 } from './lines';

const UP = new Vector3(0, 1, 0);

export interface TriangleMesh {
  /** x, y, z of every vertex, scene ENU metres. */
  positions: Float32Array;
  /** Three vertex numbers a triangle. */
  indices: Uint32Array;
}

export interface CableLine {
  from_m: Point3;
  to_m: Point3;
  radius_m: number;
}

/** The inspected structure: flat-shaded triangles, cables as cylinders, and a grid on the ground. */
export class StructureLayer extends Layer {
  constructor() {
    super('structure');
  }

  show(mesh: TriangleMesh, cables: readonly CableLine[]): void {
    this.clear();
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(mesh.positions, 3));
    geometry.setIndex(new BufferAttribute(mesh.indices, 1));
    const steel = new MeshStandardMaterial({
      color: palette.structure,
      flatShading: true,
      side: DoubleSide,
      roughness: 0.75,
      metalness: 0.15,
    });
    this.group.add(new Mesh(geometry, steel));
    for (const cable of cables) this.group.add(cylinder(cable));
  }
}

/** A square grid on the ground, 10 m a cell. */
export class GroundLayer extends Layer {
  constructor() {
    super('ground');
  }

  show(low: Point3, high: Point3, groundM: number): void {
    this.clear();
    const [x0 = 0, y0 = 0] = low;
    const [x1 = 0, y1 = 0] = high;
    const cells = 2 * Math.ceil(Math.max(x1 - x0, y1 - y0, 40) / 20 + 1);
    const grid = new GridHelper(cells * 10, cells, palette.ground, palette.ground);
    grid.rotation.x = Math.PI / 2;
    grid.position.set(Math.round((x0 + x1) / 20) * 10, Math.round((y0 + y1) / 20) * 10, groundM);
    this.group.add(grid);
  }
}

function cylinder({ from_m, to_m, radius_m }: CableLine): Mesh {
  const from = new Vector3(from_m[0], from_m[1], from_m[2]);
  const along = new Vector3(to_m[0], to_m[1], to_m[2]).sub(from);
  const length = along.length();
  const geometry = new CylinderGeometry(radius_m, radius_m, length, 8, 1, true);
  const rope = new Mesh(geometry, new MeshStandardMaterial({ color: palette.cable, roughness: 0.8 }));
  rope.position.copy(from).addScaledVector(along, 0.5);
  rope.quaternion.setFromUnitVectors(UP, along.normalize());
  return rope;
}
